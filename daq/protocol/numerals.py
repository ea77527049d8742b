"""Checks of the numbers from gauges and robots: format and range.

Without a checksum, a lost or doubled character often gives another valid number. A gauge prints every number with the
same decimals, and its length changes only where the value passes a power of ten (`+9.9985`, `+10.0012`). A digit that
became another digit keeps the format; a line with parity shows it.
"""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

from daq.protocol.conversation import Fault, FaultKind
from daq.protocol.framing import Message
from rigs.schema.part import LONGEST_MM
from rigs.schema.probe import Probe

_LASTING = 3
"""Replies in a row that fix a format: with 1 damaged reply in 200, three damaged alike occur once in ten million."""
_RECENT = 20
_REACH = 3
"""Distance that is near, as a multiple of the largest recent step.

The largest of 20 normal steps is about 2 sigma, so fewer than one in a hundred million lies further out.
"""


@dataclass(frozen=True, slots=True)
class PrintedNumber:
    value_mm: float
    text: bytes
    """All characters, including the position of the sign."""
    mm: float = 1.0
    fields: int = 1
    """Count of numbers in the message if their order identifies the gauges."""


class NumberFormat:
    """Format in which a gauge prints its numbers: decimals, numbers in a message, and characters."""

    def __init__(self) -> None:
        self._usual: tuple[int, int, int] | None = None
        """Format of the last reading."""
        self._readings = 0
        """Readings in a row with these decimals."""
        self._latest: tuple[int, int, int] | None = None
        self._repeated = 0
        """Replies in a row in the latest format, readings or not."""
        self._last_mm = math.nan
        self._steps_mm: deque[float] = deque(maxlen=_RECENT)

    def check(self, number: PrintedNumber, message: Message) -> tuple[bool, Fault | None]:
        """Whether the number is a reading, and the fault to report.

        A length that differs is accepted near the last reading, or if a second reply has it; other decimals only while
        fewer than three readings had the first ones.
        """
        decimals = len(number.text.strip().partition(b".")[2])
        found, usual, fault = (decimals, number.fields, len(number.text)), self._usual, None
        self._repeated = self._repeated + 1 if found == self._latest else 1
        self._latest = found
        last_digit_mm, step_mm = number.mm * 10.0**-decimals, abs(number.value_mm - self._last_mm)
        if usual is not None and found[:2] != usual[:2]:
            if self._readings >= _LASTING or self._repeated <= self._readings:
                return False, self._misprint(number, usual, message)
            detail = f"previous readings had {_in_words(usual)}, all later ones {_in_words(found)}; they may be damaged"
            fault, self._readings = message.fault(FaultKind.DOUBTFUL, detail, self._readings), 0
        elif (
            usual
            and found != usual
            and self._repeated == 1
            and step_mm > _REACH * max(last_digit_mm, *self._steps_mm, 0)
        ):
            return False, self._misprint(number, usual, message)
        if usual is not None:
            self._steps_mm.append(step_mm)
        self._readings += 1
        self._usual, self._last_mm = found, number.value_mm
        return True, fault

    def _misprint(self, number: PrintedNumber, usual: tuple[int, int, int], message: Message) -> Fault:
        decimals = len(number.text.strip().partition(b".")[2])
        if decimals != usual[0] and self._repeated >= _LASTING:
            change = f"the gauge writes {decimals} decimals instead of {usual[0]}"
            remedy = "in/mm was pressed, or the resolution was changed; switch it back; if it is meant, correct `units`"
            return message.fault(FaultKind.UNIT_CHANGED, f"{change}: {remedy} and restart rigd")
        text = repr(number.text[:40])[1:]
        detail = f"{text} differs in form from previous replies, which had {_in_words(usual)}"
        damage = "a character is missing, doubled or wrong: check the cable and the line settings"
        return message.fault(FaultKind.MISSHAPEN, f"{detail}; {damage}")


def keep_formats(earlier: object, later: object) -> None:
    """Check the next conversation of a link by the formats of the previous one: in/mm may be pressed in between."""
    for known, new in zip(getattr(earlier, "formats", ()), getattr(later, "formats", ()), strict=False):
        vars(new).update(vars(known))


def _in_words(shape: tuple[int, int, int]) -> str:
    decimals, fields, width = shape
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
