"""Number formats of gauges: learned from the replies, and used to detect damaged numbers.

In a reply that has no checksum, a lost or doubled character often produces a different valid number. Gauges print
all numbers in the same format: a constant number of decimals and, if padded with zeros or blanks, a constant length. A
reply in a different format is a fault instead of a reading. If the length varies (`+9.9985`, `+10.0012`), a new length
is accepted unless a single lost or doubled character would put the number closer to the extrapolation of the last two
readings. A second consistent reply always confirms it. The same applies to a missing sign if the gauge never prints
`+`.

A change in the number of decimals over several replies is not damage: the user pressed in/mm or changed the resolution.
Such readings are always rejected, because rigd cannot distinguish the two.

The format cannot reveal a digit changed to a different digit on a line that lacks parity. A jump by a single digit and
back is reported as doubtful. Changes of the last digits, within the scatter of the gauge, remain undetected.

Text that is not a number, or not a possible angle, gives None and never an exception.

A number beyond the range in the rig file, or beyond any possible length, is not a reading. Incorrectly assembled
numbers (byte or register order, type, address) are mostly beyond any length: GARBLED. A number outside the specified
range is a problem of the gauge: DEVICE_ERROR.
"""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from daq.protocol.conversation import FaultKind
from rigs.schema.part import LONGEST_MM
from rigs.schema.probe import Probe

AGREED = 20
"""Number of replies for learning a format. With 1 damaged reply in 200, damaged replies cannot be the majority."""
_LASTING = 3
"""Number of consecutive replies with a new number of decimals that count as a change.

With 1 damaged reply in 200, three equal damaged replies in a row occur less than once in ten million.
"""
_PADDED = re.compile(rb"[+\- ]?( |0\d)")
_DIGITS = b"0123456789"
_REACH = 3
"""Accepted deviation relative to the largest recent deviation. The largest of `AGREED` normal deviations is about 2
sigma, so fewer than one in a hundred million lies further out.
"""
_FAR = 10
"""Relative deviation of a reading with a wrong digit. One in ten wrong readings is closer by chance."""


@dataclass(frozen=True, slots=True)
class Written:
    """A number as printed by a gauge.

    value_mm: value. text: all characters including the position of the sign. mm: length of a unit. fields: count of
    numbers in the message, if the order identifies the gauges.
    """

    value_mm: float
    text: bytes
    mm: float = 1.0
    fields: int = 1

    @property
    def shape(self) -> Shape:
        """Format of the number."""
        return Shape(len(self.text.strip().partition(b".")[2]), len(self.text), self.fields)


@dataclass(frozen=True, slots=True)
class Shape:
    """Number of decimals, number of characters, and count of numbers in the message."""

    decimals: int
    width: int
    fields: int


@dataclass(frozen=True, slots=True)
class Doubt:
    """Reason for rejecting a number, or `count` earlier numbers."""

    kind: FaultKind
    detail: str
    count: int = 1


class HeldShape:
    """Format of the numbers printed by a gauge, used to check the next number."""

    def __init__(self) -> None:
        self._held: Shape | None = None
        self._agreed = 0
        self._padded = False
        self._other: Shape | None = None
        self._others = 0
        """A different format, and the number of consecutive replies in this format."""
        self._last_mm = self._pending_mm = float("nan")
        """Last accepted reading, and a later reading awaiting confirmation."""
        self._text = b""
        self._before_mm = float("nan")
        """Reading before the last."""
        self._bends_mm: deque[float] = deque(maxlen=AGREED)
        """Distance of each reading from the middle of its neighbours."""
        self._steps_mm: deque[float] = deque(maxlen=AGREED)
        """Signed steps between readings."""

    def check(self, written: Written) -> tuple[bool, Doubt | None]:
        """Check the next number. Return whether it is a reading, and the doubt to report."""
        shape = written.shape
        if self._held is None:
            return self._believed(written)
        if shape != self._held:
            return self._differing(written, shape, self._held)
        self._others = 0
        if self._lost_its_sign(written) and not self._borne_out(written):
            return False, self._misshapen(written, "a sign may be lost")
        return self._believed(written)

    def _differing(self, written: Written, shape: Shape, usual: Shape) -> tuple[bool, Doubt | None]:
        self._others = self._others + 1 if shape == self._other else 1
        self._other = shape
        if self._agreed < AGREED and self._others > self._agreed:
            before, self._agreed = self._agreed, 0
            doubt = f"previous readings had {_in_words(usual)}, all later ones {_in_words(shape)}; they may be damaged"
            return self._believed(written)[0], Doubt(FaultKind.DOUBTFUL, doubt, before)
        if shape.decimals != usual.decimals and self._others >= _LASTING and self._agreed >= _LASTING:
            change = f"the gauge writes {shape.decimals} decimals instead of {usual.decimals}"
            reason = "in/mm was pressed, or the resolution was changed"
            remedy = "switch it back; if it is meant, correct `units` and restart rigd"
            return False, Doubt(FaultKind.UNIT_CHANGED, f"{change}: {reason}; {remedy}")
        alike = (shape.decimals, shape.fields) == (usual.decimals, usual.fields)
        if self._others >= AGREED and shape.decimals == usual.decimals:
            return self._believed(written)  # the gauge was reconfigured
        narrower = shape.width < usual.width
        if not alike or _PADDED.match(written.text) or (self._padded and narrower):
            return False, self._misshapen(written, f"previous readings had {_in_words(usual)}")
        if self._may_be_damaged(written, shape.width - usual.width) and not self._borne_out(written):
            return False, self._misshapen(written, f"previous readings had {_in_words(usual)}")
        return self._believed(written)

    def _believed(self, written: Written) -> tuple[bool, Doubt | None]:
        """Accept a number as a reading. Report a jump of the previous reading by a single digit."""
        self._agreed += 1
        value_mm = written.value_mm
        doubt = self._one_digit(written)
        if self._text:
            self._steps_mm.append(value_mm - self._last_mm)
        self._padded = (self._padded and self._held == written.shape) or bool(_PADDED.match(written.text))
        self._held, self._text = written.shape, written.text
        self._before_mm, self._last_mm, self._pending_mm = self._last_mm, value_mm, float("nan")
        return True, doubt

    def _one_digit(self, written: Written) -> Doubt | None:
        """Doubt the previous reading if it is far from its neighbours, but near with a single digit changed."""
        middle_mm = (self._before_mm + written.value_mm) / 2
        off_mm = abs(self._last_mm - middle_mm)
        near_mm = _REACH * max([*self._bends_mm, written.mm * 10.0**-written.shape.decimals])
        # With uneven sampling a moving gauge is off the middle, but between its neighbours.
        far = len(self._bends_mm) == AGREED and off_mm > max(
            _FAR * near_mm, 1.5 * abs(written.value_mm - self._before_mm)
        )
        if not far or not any(
            abs(number * written.mm - middle_mm) <= near_mm
            for number in _with_another(self._text, _FAR * near_mm / written.mm)
        ):
            if math.isfinite(off_mm):  # a distant reading is treated as near, because it may itself be wrong
                self._bends_mm.append(min(off_mm, near_mm) if len(self._bends_mm) == AGREED else off_mm)
            return None
        detail = f"{self._last_mm:.6g} mm between {self._before_mm:.6g} and {written.value_mm:.6g} mm"
        self._last_mm = middle_mm
        return Doubt(FaultKind.DOUBTFUL, f"isolated reading of {detail}: a digit may be damaged; check the cable")

    @property
    def _expected_mm(self) -> float:
        """Return the extrapolation of the last two readings."""
        return self._last_mm + (self._steps_mm[-1] if self._steps_mm else 0.0)

    def _borne_out(self, written: Written) -> bool:
        """Return whether the number is closer to the unconfirmed reading than to the last accepted reading."""
        if abs(written.value_mm - self._pending_mm) < abs(written.value_mm - self._last_mm):
            return True
        self._pending_mm = written.value_mm
        return False

    def _may_be_damaged(self, written: Written, wider: int) -> bool:
        """Return whether a lost or doubled character explains the number better than motion since the last reading."""
        if abs(wider) > 1:
            return True
        text = written.text
        if wider > 0:  # a digit was doubled
            doubled = (k for k in range(1, len(text)) if text[k] == text[k - 1] and text[k] in _DIGITS)
            originals = [text[:k] + text[k + 1 :] for k in doubled]
        else:  # a digit before the point was lost
            first = next(k for k, byte in enumerate(text) if byte in _DIGITS)
            places = range(first, text.index(b".") + 1)
            originals = [text[:k] + bytes([digit]) + text[k:] for k in places for digit in _DIGITS]
        off_mm = abs(written.value_mm - self._expected_mm)
        return any(abs(_number(original) * written.mm - self._expected_mm) < off_mm for original in originals)

    def _lost_its_sign(self, written: Written) -> bool:
        if b"-" not in self._text or b"-" in written.text or b"+" in written.text:
            return False
        reach_mm = _REACH * max([*map(abs, self._steps_mm), written.mm * 10.0**-written.shape.decimals])
        if len(self._steps_mm) < AGREED or abs(written.value_mm - self._last_mm) <= reach_mm:
            return False
        return abs(-written.value_mm - self._expected_mm) < abs(written.value_mm - self._expected_mm)

    def _misshapen(self, written: Written, why: str) -> Doubt:
        text = repr(written.text[:40])[1:]
        detail = f"{text} differs in form from previous replies, {why}; a character is missing, doubled or wrong"
        return Doubt(FaultKind.MISSHAPEN, f"{detail}: check the cable and the line settings")


@runtime_checkable
class Shaped(Protocol):
    """Checks the numbers of gauges, in order, against the learned formats."""

    shapes: list[HeldShape]


class PassesShapes:
    """Conversation with the formats of the dialect or inner conversation; empty for binary values."""

    _asked: object

    @property
    def shapes(self) -> list[HeldShape]:
        return self._asked.shapes if isinstance(self._asked, Shaped) else []

    @shapes.setter
    def shapes(self, shapes: list[HeldShape]) -> None:
        if isinstance(self._asked, Shaped):
            self._asked.shapes = shapes


def hand_on(earlier: object, later: object) -> None:
    """Pass on learned formats to the next conversation of a link.

    Reconnecting a plug does not change a gauge, and a change of in/mm in the meantime is detected.
    """
    if isinstance(earlier, Shaped) and isinstance(later, Shaped):
        later.shapes = earlier.shapes


def _in_words(shape: Shape) -> str:
    numbers = f", {shape.fields} to a message" if shape.fields > 1 else ""
    return f"{shape.width} characters with {shape.decimals} decimals{numbers}"


def _number(text: bytes) -> float:
    return float(text.replace(b" ", b""))


def _with_another(text: bytes, least: float) -> Iterator[float]:
    """Return the numbers produced by a single wrong digit in this text, for digits worth at least `least`."""
    point = text.index(b".")
    for k, byte in enumerate(text):
        stands_for = 10.0 ** (point - k - (k < point))
        for digit in _DIGITS if byte in _DIGITS and stands_for >= least else b"":
            yield _number(text[:k] + bytes([digit]) + text[k + 1 :])


_NUMBER = re.compile(r"[+-]?(\d{1,18}(\.\d{0,18})?|\.\d{1,18})([eE][+-]?\d{1,2})?", re.ASCII)
_MAX_DEG = 1e6
"""Largest possible angle of an axis."""
_LARGEST_BESIDE = 1e9
"""Upper limit of speeds in percent, masses, temperatures and program numbers."""


def number(text: str) -> float | None:
    """Parse a decimal number; None for other text (nan, inf, hexadecimal, underscores, a hundred digits)."""
    return float(text) if _NUMBER.fullmatch(text) else None


def are_angles(values_deg: Iterable[float]) -> bool:
    """Return whether all values are finite and possible axis angles."""
    return all(abs(value) < _MAX_DEG for value in values_deg)


def plausible(value: float) -> float:
    """Return an additional value of a robot, or nan if impossible for a speed, mass, temperature or program number."""
    return value if abs(value) <= _LARGEST_BESIDE else math.nan


_LEAST_MM = 1e-20
"""Smallest possible length. Rounding differences of lengths near 0.1 mm gives 1e-17 or exactly 0."""


def is_length(value_mm: float) -> bool:
    """Return whether a number is a possible measured length; False for nan and infinity."""
    return value_mm == 0 or _LEAST_MM < abs(value_mm) <= LONGEST_MM


def refusal(value_mm: float, gauge: Probe) -> tuple[FaultKind, str] | None:
    """Return the reason for rejecting a number of this gauge, with advice; None if it is valid."""
    if not is_length(value_mm):
        return FaultKind.GARBLED, f"{value_mm:.3g} mm is not a plausible gauge reading; check `units`"
    if gauge.limits_mm is None or gauge.limits_mm[0] <= value_mm <= gauge.limits_mm[1]:
        return None
    lowest_mm, highest_mm = gauge.limits_mm
    where = f"a reading outside its range_mm, {lowest_mm:g} to {highest_mm:g} mm"
    return FaultKind.DEVICE_ERROR, f"{where}; move the probe into the range, or correct `range_mm` or `units`"
