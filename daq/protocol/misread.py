"""Check of printed numbers in hindsight: a changed digit or sign leaves the format as it was.

Such a number is a reading until its neighbours are known. It is doubted if it is far from them, they are close to each
other, and one other character would bring it to its place. Real motion rarely does all three.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from daq.protocol.printed_number import PrintedNumber

_BEFORE, _AFTER = 6, 2
"""Neighbours with which a reading is compared."""
_FAR = 20
"""Deviation of a doubted reading, as a multiple of the largest deviation of its neighbours.

The deviations of eight neighbours with normal scatter, six of which are independent, are all below 0.2 sigma once in
60 000 times, and a reading beyond 4 sigma occurs once in 16 000: together once in a billion readings.
"""


@dataclass(frozen=True, slots=True)
class Misread:
    """A reading with a probable wrong character, and the length expected in its place."""

    number: PrintedNumber
    expected_mm: float


@dataclass(frozen=True, slots=True)
class _Timed:
    number: PrintedNumber
    at_ns: int

    @property
    def value_mm(self) -> float:
        return self.number.value_mm


class RecentNumbers:
    """The last readings of a gauge."""

    def __init__(self) -> None:
        self._recent: deque[_Timed] = deque(maxlen=_BEFORE + 1 + _AFTER)
        self._has_compared_first = False

    def add(self, number: PrintedNumber, at_ns: int) -> Misread | None:
        """Add a reading, and return an earlier one that was probably misread, if any.

        The first readings are compared as soon as there are enough of them, and each later one when two have followed.
        """
        self._recent.append(_Timed(number, at_ns))
        if len(self._recent) <= _BEFORE + _AFTER:
            return None
        places = (_BEFORE,) if self._has_compared_first else range(_BEFORE + 1)
        self._has_compared_first = True
        for place in places:
            if misread := _misread(self._recent, place):
                del self._recent[place]
                return misread
        return None

    def clear(self) -> None:
        self._recent.clear()
        self._has_compared_first = False


def _misread(readings: Sequence[_Timed], place: int) -> Misread | None:
    number = readings[place].number
    expected_mm, spread_mm = _expected_mm(readings, place), number.last_digit_mm
    away_mm = abs(number.value_mm - expected_mm)
    if away_mm <= _FAR * spread_mm:
        return None
    others = [other for k, other in enumerate(readings) if k != place]
    spread_mm = max(spread_mm, *(abs(other.value_mm - _expected_mm(others, k)) for k, other in enumerate(others)))
    if away_mm <= _FAR * spread_mm:
        return None
    originals = (*number.with_other_character(), *number.with_lost_or_added_character())
    is_explained = any(abs(mm - expected_mm) <= 2 * spread_mm for mm in originals)
    return Misread(number, expected_mm) if is_explained else None


def _expected_mm(readings: Sequence[_Timed], place: int) -> float:
    """Length on the line through the readings before and after a place, or at an end through the nearest two."""
    last = len(readings) - 1
    one, other = {0: (1, 2), last: (last - 2, last - 1)}.get(place, (place - 1, place + 1))
    span_ns = readings[other].at_ns - readings[one].at_ns
    share = (readings[place].at_ns - readings[one].at_ns) / span_ns if span_ns else 0.5
    return readings[one].value_mm + share * (readings[other].value_mm - readings[one].value_mm)
