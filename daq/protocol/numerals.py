"""Checks of the numbers from gauges and robots: format and range.

Without a checksum, a lost or doubled character often gives another valid number. A gauge prints every number with the
same decimals, and its length changes only where the value passes a power of ten (`+9.9985`, `+10.0012`). A number
filled up with blanks or zeros never changes its length. A digit that became another digit keeps the format; a line with
parity shows it.
"""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from statistics import median

from daq.protocol.conversation import Fault, FaultKind, Sample
from daq.protocol.framing import Message
from daq.protocol.misread import RecentNumbers
from daq.protocol.printed_number import PrintedNumber
from rigs.schema.part import LONGEST_MM
from rigs.schema.probe import Probe

_LASTING = 3
"""Replies in a row that fix a format: with 1 damaged reply in 200, three damaged alike occur once in ten million."""
_RECENT = 20
_REACH = 3
"""Distance that is near, as a multiple of the second largest recent step.

Of 20 normal steps it is about 1.5 sigma, so a false refusal, which costs two readings, occurs once in 100 000.
"""
_SCATTER = 10
"""Distance from the mean of two neighbours that is scatter, as a multiple of the recent median: 7 sigma."""
_CONFIRMED_WITHIN_NS = 1_000_000_000
"""Longest time for which a reading is held back: later, a run could have begun in between."""
_RECENT_FIRST = 6
"""First readings that are compared with each other."""


@dataclass(frozen=True, slots=True)
class _HeldReading:
    number: PrintedNumber
    message: Message
    requested_ns: int

    def sample(self) -> Sample:
        return self.message.sample([self.number.value_mm], requested_ns=self.requested_ns)


class NumberFormat:
    """Format in which a gauge prints its numbers: decimals, numbers in a message, and characters."""

    def __init__(self) -> None:
        self._usual: PrintedNumber | None = None
        """Last reading."""
        self._is_filled = False
        self._readings = 0
        """Readings in a row with these decimals."""
        self._latest: PrintedNumber | None = None
        self._repeated = 0
        """Replies in a row in the latest format, readings or not."""
        self._far = 0
        """Replies in a row that are far from the last reading."""
        self._steps_mm: deque[float] = deque(maxlen=_RECENT)
        """Recent differences of successive readings, with sign."""
        self._held: _HeldReading | None = None
        """First number without a minus near zero, until the next reading confirms it or not."""
        self._first: list[PrintedNumber] = []
        """First readings, until their format is certain."""
        self._is_doubted = False
        self._recent = RecentNumbers()

    def check(self, number: PrintedNumber, message: Message, requested_ns: int) -> tuple[bool, list[Sample | Fault]]:
        """Whether the number is a reading, with faults and a confirmed earlier reading.

        A number that a lost character explains is accepted near the last reading, or if three replies in a row are
        alike. Near zero, the first number without a minus is held back until the next reading. Other decimals are
        accepted only while fewer than three readings had the first ones.
        """
        usual, latest = self._usual, self._latest
        items: list[Sample | Fault] = []
        self._repeated = self._repeated + 1 if latest and number.form == latest.form else 1
        self._latest = number
        if usual is not None and number.form[:2] != usual.form[:2]:
            if self._readings >= _LASTING or self._repeated <= self._readings:
                return False, [self._misprint(number, usual, message)]
            detail = f"all later replies have {_in_words(number)} instead of {_in_words(usual)}"
            items.append(
                message.fault(FaultKind.DOUBTFUL, f"{_may_be_damaged(self._readings)}: {detail}", self._readings)
            )
            self._readings, self._first, self._is_filled = 0, [], False
            self._steps_mm.clear()
            self._recent.clear()
        elif usual is not None and self._is_far(number, usual):
            self._far = min(self._far + 1, self._repeated)
            if self._far < _LASTING:
                return False, [self._misprint(number, usual, message)]
            self._is_filled = False
        elif usual is not None and self._held is None and self._may_lack_minus(number, usual):
            self._held = _HeldReading(number, message, requested_ns)
            return False, []
        if self._held and usual is not None:
            items.append(self._judge(self._held, usual, number, message))
            self._held = None
        self._far = 0
        self._is_filled |= number.is_filled
        doubts = [self._accept(number, message), None if items else self._doubt_of_first(number, message)]
        return True, [*items, *filter(None, doubts)]

    def _accept(self, number: PrintedNumber, message: Message) -> Fault | None:
        """Note a reading, and return the doubt about an earlier one that it shows to be misread, if any."""
        if self._usual is not None:
            self._steps_mm.append(number.value_mm - self._usual.value_mm)
        self._readings += 1
        self._usual = number
        misread = self._recent.add(number, message.last_byte_ns)
        if misread is None:
            return None
        for step_mm in sorted(self._steps_mm, key=abs)[-2:]:  # to the misread number and back
            self._steps_mm.remove(step_mm)
        detail = (
            f"{_quoted(misread.number)} may have a wrong character: its neighbours lie at {misread.expected_mm:g} mm"
        )
        return message.fault(FaultKind.DOUBTFUL, f"{detail}: check the cable, and use parity if possible")

    def _judge(
        self, held: _HeldReading, usual: PrintedNumber, number: PrintedNumber, message: Message
    ) -> Sample | Fault:
        """Decide about the reading held back, now that its successor `number` is known.

        Returns its sample, or a MISSHAPEN fault if its minus was probably lost or `number` came too late to tell.
        The sign counts as right if the value is nearer to the mean of its neighbours than its negative is, or
        within the usual scatter above that mean.
        """
        mean_mm = (usual.value_mm + number.value_mm) / 2
        usual_mm = [abs(later - earlier) / 2 for earlier, later in pairwise(self._steps_mm)]
        usual_scatter_mm = median(usual_mm) if len(usual_mm) >= _LASTING else 0.0  # of fewer, one may be misread
        reach_mm = _SCATTER * max(number.last_digit_mm, usual_scatter_mm)
        is_likely = mean_mm > 0 or held.number.value_mm - mean_mm <= reach_mm
        if is_likely and message.last_byte_ns - held.message.last_byte_ns <= _CONFIRMED_WITHIN_NS:
            self._accept(held.number, held.message)
            return held.sample()
        detail = f"{_quoted(held.number)} between {usual.value_mm:g} and {number.value_mm:g} mm may have lost its minus"
        return held.message.fault(FaultKind.MISSHAPEN, f"{detail}: check the cable, or zero the gauge further away")

    def _is_far(self, number: PrintedNumber, usual: PrintedNumber) -> bool:
        """True if the number cannot follow the last reading, and a lost character explains it."""
        is_longer = len(number.text) != len(usual.text)
        if is_longer and self._is_filled:
            return True
        reach_mm = self._reach_mm(number)
        if abs(number.value_mm - usual.value_mm) <= reach_mm:
            return False
        return is_longer or any(abs(mm - usual.value_mm) <= reach_mm for mm in number.with_lost_or_added_character())

    def _may_lack_minus(self, number: PrintedNumber, usual: PrintedNumber) -> bool:
        """True for the first number without a minus near zero, where both signs are possible."""
        is_first = number.omits_plus and not usual.omits_plus
        return is_first and abs(number.value_mm) > _REACH * number.last_digit_mm

    def _reach_mm(self, number: PrintedNumber) -> float:
        steps_mm = sorted(map(abs, self._steps_mm))
        return _REACH * max(number.last_digit_mm, *steps_mm[-2:-1], 0)

    def _doubt_of_first(self, number: PrintedNumber, message: Message) -> Fault | None:
        """Fault for first readings that differ from the following ones as if they had lost a character."""
        if len(self._first) > _RECENT_FIRST:
            return None
        self._first.append(number)
        if self._is_doubted or len(self._first) <= _LASTING:
            return None
        for place, (first, following) in enumerate(pairwise(self._first[:-1]), 1):
            step_mm = abs(following.value_mm - first.value_mm)
            reach_mm = max(self._reach_mm(number), _REACH * abs(number.value_mm - self._first[-2].value_mm))
            lost = (mm for mm in first.with_lost_or_added_character() if abs(mm - following.value_mm) <= reach_mm)
            if step_mm > reach_mm and next(lost, None) is not None:
                self._is_doubted = True
                detail = (
                    f"{_may_be_damaged(place)}: {_quoted(first)} is far from {following.value_mm:g} mm; check the cable"
                )
                return message.fault(FaultKind.DOUBTFUL, detail, place)
        return None

    def _misprint(self, number: PrintedNumber, usual: PrintedNumber, message: Message) -> Fault:
        if number.decimals != usual.decimals and self._repeated >= _LASTING:
            change = f"the gauge writes {number.decimals} decimals instead of {usual.decimals}"
            remedy = "in/mm was pressed, or the resolution was changed; switch it back; if it is meant, correct `units`"
            return message.fault(FaultKind.UNIT_CHANGED, f"{change}: {remedy} and restart rigd")
        damage = "a character is missing, doubled or wrong: check the cable and the line settings"
        if number.form == usual.form:
            detail = f"{_quoted(number)} is far from the previous {usual.value_mm:g} mm"
        else:
            detail = f"{_quoted(number)} differs in form from previous replies, which had {_in_words(usual)}"
        if self._readings < _LASTING and not self._is_doubted:
            self._is_doubted = True
            detail = f"{_may_be_damaged(self._readings)}, or this one: {detail}"
            return message.fault(FaultKind.DOUBTFUL, f"{detail}; {damage}", self._readings)
        return message.fault(FaultKind.MISSHAPEN, f"{detail}; {damage}")


def keep_formats(earlier: object, later: object) -> None:
    """Check the next conversation of a link by the formats of the previous one: in/mm may be pressed in between."""
    for known, new in zip(getattr(earlier, "formats", ()), getattr(later, "formats", ()), strict=False):
        vars(new).update(vars(known))


def _may_be_damaged(count: int) -> str:
    return "the first reading may be damaged" if count == 1 else f"the first {count} readings may be damaged"


def _quoted(number: PrintedNumber) -> str:
    return repr(number.text[:40])[1:]


def _in_words(number: PrintedNumber) -> str:
    decimals, fields, width = number.form
    numbers = f", {fields} to a message" if fields > 1 else ""
    return f"{width} characters with {decimals} decimals{numbers}"


_NUMBER = re.compile(r"[+-]?(\d{1,18}(\.\d{0,18})?|\.\d{1,18})([eE][+-]?\d{1,2})?", re.ASCII)
_MAX_DEG = 1e6
_LARGEST_BESIDE = 1e9
"""Limit of speeds in percent, masses, temperatures and program numbers."""
_LEAST_MM = 1e-20
"""Smallest possible length. Rounding differences of lengths near 0.1 mm gives 1e-17 or exactly 0."""


def number(text: str) -> float | None:
    """Decimal number; None for other text (nan, inf, hexadecimal, underscores, a hundred digits)."""
    return float(text) if _NUMBER.fullmatch(text) else None


def are_angles(values_deg: Iterable[float]) -> bool:
    return all(abs(value) < _MAX_DEG for value in values_deg)


def plausible(value: float) -> float:
    """An additional value of a robot, or nan if it is impossible."""
    return value if abs(value) <= _LARGEST_BESIDE else math.nan


def is_length(value_mm: float) -> bool:
    return value_mm == 0 or _LEAST_MM < abs(value_mm) <= LONGEST_MM


def refusal(value_mm: float, gauge: Probe) -> tuple[FaultKind, str] | None:
    """Why a number is no reading of this gauge, with advice.

    No possible length: mostly assembled incorrectly (byte or register order, type, address), so GARBLED. Outside the
    range of the rig file: a problem of the gauge, so DEVICE_ERROR.
    """
    if not is_length(value_mm):
        return FaultKind.GARBLED, f"{value_mm:.3g} mm is not a plausible gauge reading; check `units`"
    if gauge.limits_mm is None or gauge.limits_mm[0] <= value_mm <= gauge.limits_mm[1]:
        return None
    lowest_mm, highest_mm = gauge.limits_mm
    where = f"a reading outside its range_mm, {lowest_mm:g} to {highest_mm:g} mm"
    return FaultKind.DEVICE_ERROR, f"{where}; move the probe into the range, or correct `range_mm` or `units`"
