"""A number as a gauge prints it, and the numbers that a damaged character could have made of another one."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

_FILLED = re.compile(rb"[+-]? *0\d|.? \s*\d|[+-] ")
"""Leading blanks (next to one for the sign) or zeros, which give all numbers the same length."""


@dataclass(frozen=True, slots=True)
class PrintedNumber:
    value_mm: float
    text: bytes
    """All characters, including the position of the sign."""
    mm: float = 1.0
    fields: int = 1
    """Count of numbers in the message if their order identifies the gauges."""
    omits_plus: bool = False
    """True if the number could be a negative one that lost its sign. It is then the only one in the message."""

    @property
    def decimals(self) -> int:
        return len(self.text.strip().partition(b".")[2])

    @property
    def form(self) -> tuple[int, int, int]:
        return self.decimals, self.fields, len(self.text)

    @property
    def is_filled(self) -> bool:
        return bool(_FILLED.match(self.text))

    @property
    def last_digit_mm(self) -> float:
        """Step of the last digit, increased by the rounding of floating-point differences."""
        return self.mm * 10.0**-self.decimals * (1 + 1e-9)

    def with_lost_or_added_character(self) -> Iterator[float]:
        """Lengths with the same decimals from which a lost or added character makes this number."""
        if self.omits_plus:
            yield -self.value_mm
        whole, _, decimals = self._digits.partition(".")
        for place in range(len(whole) + 1):
            for digit in "0123456789":
                yield self._length_mm(f"{whole[:place]}{digit}{whole[place:]}.{decimals}")
            yield self._length_mm(f"0{whole[:place]}{whole[place + 1 :]}.{decimals}")

    def with_other_character(self) -> Iterator[float]:
        """Lengths that another digit or sign makes of this number."""
        yield -self.value_mm
        digits = self._digits
        for place, character in enumerate(digits):
            if character != ".":
                for digit in "0123456789":
                    yield self._length_mm(f"{digits[:place]}{digit}{digits[place + 1 :]}")

    @property
    def _digits(self) -> str:
        return self.text.replace(b" ", b"").lstrip(b"+-").decode("ascii")

    def _length_mm(self, digits: str) -> float:
        return (-self.mm if b"-" in self.text else self.mm) * float(digits)
