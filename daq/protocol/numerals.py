"""Checks of numbers from gauges and robots: format, range, and text that is no number.

In a reply without checksum, a lost or doubled character often produces a different valid number. Gauges print all
numbers with the same number of decimals, and the length changes only where the value moves there (`+9.9985`,
`+10.0012`). A reply in another format is therefore a fault unless it is near the last reading, or the next reply
confirms it. Another number of decimals is always a fault: the user pressed in/mm or changed the resolution. A digit
that became another digit keeps the format; a line with parity shows it.

A number beyond any possible length is mostly assembled incorrectly (byte or register order, type, address): GARBLED. A
number outside the range in the rig file is a problem of the gauge: DEVICE_ERROR.
"""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

from daq.protocol.conversation import FaultKind
from rigs.schema.part import LONGEST_MM
from rigs.schema.probe import Probe

_LASTING = 3
"""Replies in a row that establish or change a format.

With 1 damaged reply in 200, three equally damaged in a row occur less than once in ten million.
"""
_REMEMBERED = 20
_REACH = 3
"""Distance that is near, as a multiple of the largest of the last steps.

The largest of 20 normal steps is about 2 sigma, so fewer than one in a hundred million lies further out.
"""


@dataclass(frozen=True, slots=True)
class Written:
    """A number as printed by a gauge.

    text: all characters including the position of the sign. mm: length of a unit. fields: count of numbers in the
    message, if the order identifies the gauges.
    """

    value_mm: float
    text: bytes
    mm: float = 1.0
    fields: int = 1

    @property
    def shape(self) -> tuple[int, int, int]:
        """Decimals, numbers in the message, and characters."""
        return len(self.text.strip().partition(b".")[2]), self.fields, len(self.text)


@dataclass(frozen=True, slots=True)
class Doubt:
    """Reason for rejecting a number, or `count` earlier numbers."""

    kind: FaultKind
    detail: str
    count: int = 1


class HeldShape:
    """Format of the numbers printed by a gauge, used to check the next one."""

    def __init__(self) -> None:
        self._usual: tuple[int, int, int] | None = None
        self._agreed = 0
        """Readings in a row with these decimals."""
        self._latest: tuple[int, int, int] | None = None
        self._repeated = 0
        """Replies in a row in the latest format."""
        self._last_mm = math.nan
        self._steps_mm: deque[float] = deque(maxlen=_REMEMBERED)

    def check(self, written: Written) -> tuple[bool, Doubt | None]:
        """Whether the next number is a reading, and the doubt to report."""
        shape, usual, doubt = written.shape, self._usual, None
        self._repeated = self._repeated + 1 if shape == self._latest else 1
        self._latest = shape
        if usual is not None and shape[:2] != usual[:2]:
            if self._agreed >= _LASTING or self._repeated <= self._agreed:
                return False, self._refusal(written, usual)
            detail = f"previous readings had {_in_words(usual)}, all later ones {_in_words(shape)}; they may be damaged"
            doubt, self._agreed = Doubt(FaultKind.DOUBTFUL, detail, self._agreed), 0
        elif usual is not None and shape != usual and self._repeated < 2 and not self._is_near(written):
            return False, self._refusal(written, usual)
        if self._usual is not None:
            self._steps_mm.append(abs(written.value_mm - self._last_mm))
        self._agreed += 1
        self._usual, self._last_mm = shape, written.value_mm
        return True, doubt

    def _is_near(self, written: Written) -> bool:
        last_digit_mm = written.mm * 10.0 ** -written.shape[0]
        return abs(written.value_mm - self._last_mm) <= _REACH * max([*self._steps_mm, last_digit_mm])

    def _refusal(self, written: Written, usual: tuple[int, int, int]) -> Doubt:
        decimals = written.shape[0]
        if decimals != usual[0] and self._repeated >= _LASTING:
            change = f"the gauge writes {decimals} decimals instead of {usual[0]}"
            reason = "in/mm was pressed, or the resolution was changed"
            remedy = "switch it back; if it is meant, correct `units` and restart rigd"
            return Doubt(FaultKind.UNIT_CHANGED, f"{change}: {reason}; {remedy}")
        text = repr(written.text[:40])[1:]
        detail = f"{text} differs in form from previous replies, which had {_in_words(usual)}"
        damage = "a character is missing, doubled or wrong: check the cable and the line settings"
        return Doubt(FaultKind.MISSHAPEN, f"{detail}; {damage}")


class PassesShapes:
    """Conversation with the formats of its dialect or inner conversation, one per gauge; None for binary values."""

    _asked: object

    @property
    def shapes(self) -> list[HeldShape] | None:
        return getattr(self._asked, "shapes", None)

    @shapes.setter
    def shapes(self, shapes: list[HeldShape]) -> None:
        self._asked.shapes = shapes  # type: ignore[attr-defined] # of the same driver as the earlier conversation


def hand_on(earlier: object, later: object) -> None:
    """Pass on the formats to the next conversation of a link.

    Reconnecting a plug does not change a gauge, and a change of in/mm in the meantime is detected.
    """
    if isinstance(earlier, PassesShapes) and isinstance(later, PassesShapes) and earlier.shapes:
        later.shapes = earlier.shapes


def _in_words(shape: tuple[int, int, int]) -> str:
    decimals, fields, width = shape
    numbers = f", {fields} to a message" if fields > 1 else ""
    return f"{width} characters with {decimals} decimals{numbers}"


_NUMBER = re.compile(r"[+-]?(\d{1,18}(\.\d{0,18})?|\.\d{1,18})([eE][+-]?\d{1,2})?", re.ASCII)
_MAX_DEG = 1e6
_LARGEST_BESIDE = 1e9
"""For speeds in percent, masses, temperatures and program numbers."""


def number(text: str) -> float | None:
    """Decimal number; None for other text (nan, inf, hexadecimal, underscores, a hundred digits)."""
    return float(text) if _NUMBER.fullmatch(text) else None


def are_angles(values_deg: Iterable[float]) -> bool:
    return all(abs(value) < _MAX_DEG for value in values_deg)


def plausible(value: float) -> float:
    """An additional value of a robot, or nan if it is impossible."""
    return value if abs(value) <= _LARGEST_BESIDE else math.nan


_LEAST_MM = 1e-20
"""Smallest possible length. Rounding differences of lengths near 0.1 mm gives 1e-17 or exactly 0."""


def is_length(value_mm: float) -> bool:
    return value_mm == 0 or _LEAST_MM < abs(value_mm) <= LONGEST_MM


def refusal(value_mm: float, gauge: Probe) -> tuple[FaultKind, str] | None:
    """Why a number is no reading of this gauge, with advice."""
    if not is_length(value_mm):
        return FaultKind.GARBLED, f"{value_mm:.3g} mm is not a plausible gauge reading; check `units`"
    if gauge.limits_mm is None or gauge.limits_mm[0] <= value_mm <= gauge.limits_mm[1]:
        return None
    lowest_mm, highest_mm = gauge.limits_mm
    where = f"a reading outside its range_mm, {lowest_mm:g} to {highest_mm:g} mm"
    return FaultKind.DEVICE_ERROR, f"{where}; move the probe into the range, or correct `range_mm` or `units`"
