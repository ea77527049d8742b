"""Numbers as gauges print them: the shape in which each writes its own, learned from its replies, and what to make of
one that differs.

Where a reply has no checksum, one that has lost or doubled a character is most often a number still, and another one.
A gauge writes all its numbers alike, and that shows it: the number of decimals is always the same; where the number is
filled up with zeros or blanks, so is its length. A reply of another shape is a fault and no reading. Where the length
is that of the number (`+9.9985`, `+10.0012`) another length is believed unless a number of which one lost or doubled
character makes it lies nearer to where the last two readings lead, and even then as soon as a second reply bears it
out. So is a number without its sign, on a gauge that writes no `+`.

Another number of decimals reply after reply is no damage: somebody has pressed in/mm, or changed the resolution. Such
readings are never believed, since rigd cannot know which of the two it was.

What no shape shows is a digit that became another one, on a line without parity. Where the reading jumps by one digit
and back it is reported as doubtful. A change of the last digits, of the size of what the gauge scatters, shows nowhere.

What is no number, or no possible angle, gives None and never an exception.

A number beyond the range that the rig file states, or beyond any length there is, is no reading. One that was put
together wrongly (bytes or registers in the wrong order, a wrong type or address) is most often beyond any length. It is
GARBLED; one outside the stated range is the gauge's own trouble, DEVICE_ERROR.
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
"""Replies by which a shape is known: of so many, one in 200 of which is damaged, not half are."""
_LASTING = 3
"""Replies in a row with another number of decimals that are a change, and no damage: one in 200 is damaged, so three in
a row are, alike, less than once in some ten million."""
_PADDED = re.compile(rb"[+\- ]?( |0\d)")
_DIGITS = b"0123456789"
_REACH = 3
"""How many times as far as the furthest of late a reading may lie: of `AGREED` normal deviations the furthest is some 2
sigma, so less than one in a hundred million lies further."""
_FAR = 10
"""How many times as far a reading lies of which a digit is false; one that is so near by chance is then one in ten."""


@dataclass(frozen=True, slots=True)
class Written:
    """A number as a gauge wrote it. value_mm: what it says; text: all of it, with the place of its sign.

    mm: what one of its unit is; fields: how many numbers the message has, where their order says whose they are.
    """

    value_mm: float
    text: bytes
    mm: float = 1.0
    fields: int = 1

    @property
    def shape(self) -> Shape:
        """The shape of the number."""
        return Shape(len(self.text.strip().partition(b".")[2]), len(self.text), self.fields)


@dataclass(frozen=True, slots=True)
class Shape:
    """Number of decimals, characters of the number, and numbers in its message."""

    decimals: int
    width: int
    fields: int


@dataclass(frozen=True, slots=True)
class Doubt:
    """Why a number is not believed, or `count` earlier ones are not any more."""

    kind: FaultKind
    detail: str
    count: int = 1


class HeldShape:
    """What one gauge has written so far, to which the next number is held."""

    def __init__(self) -> None:
        self._held: Shape | None = None
        self._agreed = 0
        self._padded = False
        self._other: Shape | None = None
        self._others = 0
        """Another shape, and how many replies in a row have had it."""
        self._last_mm = self._pending_mm = float("nan")
        """The last reading that was believed, and one after it that is to be borne out."""
        self._text = b""
        self._before_mm = float("nan")
        """The reading before the last one."""
        self._bends_mm: deque[float] = deque(maxlen=AGREED)
        """How far each reading lay from the middle of its neighbours."""
        self._steps_mm: deque[float] = deque(maxlen=AGREED)
        """From each reading to the next, signed."""

    def check(self, written: Written) -> tuple[bool, Doubt | None]:
        """Take the next number; return whether it is a reading, and what is to be reported."""
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
            doubt = f"readings before had {_in_words(usual)}, all since have {_in_words(shape)}; they may be damaged"
            return self._believed(written)[0], Doubt(FaultKind.DOUBTFUL, doubt, before)
        if shape.decimals != usual.decimals and self._others >= _LASTING and self._agreed >= _LASTING:
            change = f"the gauge writes {shape.decimals} decimals, before it wrote {usual.decimals}"
            reason = "somebody pressed in/mm, or changed its resolution"
            remedy = "switch it back; if it is meant, correct `units` and start rigd again"
            return False, Doubt(FaultKind.UNIT_CHANGED, f"{change}: {reason}; {remedy}")
        alike = (shape.decimals, shape.fields) == (usual.decimals, usual.fields)
        if self._others >= AGREED and shape.decimals == usual.decimals:
            return self._believed(written)  # it was set otherwise
        narrower = shape.width < usual.width
        if not alike or _PADDED.match(written.text) or (self._padded and narrower):
            return False, self._misshapen(written, f"so far they had {_in_words(usual)}")
        if self._may_be_damaged(written, shape.width - usual.width) and not self._borne_out(written):
            return False, self._misshapen(written, f"so far they had {_in_words(usual)}")
        return self._believed(written)

    def _believed(self, written: Written) -> tuple[bool, Doubt | None]:
        """Take a number as a reading; report where the one before it jumped away by one digit, alone."""
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
        """Doubt the reading before this one where it lies far from the middle of its neighbours, and near it were one
        of its digits another."""
        middle_mm = (self._before_mm + written.value_mm) / 2
        off_mm = abs(self._last_mm - middle_mm)
        near_mm = _REACH * max([*self._bends_mm, written.mm * 10.0**-written.shape.decimals])
        # Where the readings come unevenly a moving gauge lies off the middle, but between its neighbours.
        far = len(self._bends_mm) == AGREED and off_mm > max(
            _FAR * near_mm, 1.5 * abs(written.value_mm - self._before_mm)
        )
        if not far or not any(
            abs(number * written.mm - middle_mm) <= near_mm
            for number in _with_another(self._text, _FAR * near_mm / written.mm)
        ):
            if math.isfinite(off_mm):  # one that is far takes part as one that is near: it may be false itself
                self._bends_mm.append(min(off_mm, near_mm) if len(self._bends_mm) == AGREED else off_mm)
            return None
        detail = f"{self._last_mm:.6g} mm alone between {self._before_mm:.6g} and {written.value_mm:.6g} mm"
        self._last_mm = middle_mm
        return Doubt(FaultKind.DOUBTFUL, f"a reading of {detail}: one digit may be damaged; check the cable")

    @property
    def _expected_mm(self) -> float:
        """Where the last two readings lead."""
        return self._last_mm + (self._steps_mm[-1] if self._steps_mm else 0.0)

    def _borne_out(self, written: Written) -> bool:
        """Whether the number lies nearer to the one that waits to be borne out than to the last that was believed."""
        if abs(written.value_mm - self._pending_mm) < abs(written.value_mm - self._last_mm):
            return True
        self._pending_mm = written.value_mm
        return False

    def _may_be_damaged(self, written: Written, wider: int) -> bool:
        """Whether a lost or doubled character explains the number better than a motion since the last reading."""
        if abs(wider) > 1:
            return True
        text = written.text
        if wider > 0:  # one digit was doubled
            doubled = (k for k in range(1, len(text)) if text[k] == text[k - 1] and text[k] in _DIGITS)
            originals = [text[:k] + text[k + 1 :] for k in doubled]
        else:  # one before the point was lost
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
        detail = f"{text} is not written as the replies before, {why}; a character is lost, doubled or false"
        return Doubt(FaultKind.MISSHAPEN, f"{detail}: check the cable and the line's settings")


@runtime_checkable
class Shaped(Protocol):
    """What holds the numbers of its gauges, in order, to the shapes of those before them."""

    shapes: list[HeldShape]


class PassesShapes:
    """A conversation whose shapes are those of what it asks by: a dialect or another conversation, which has none if
    its numbers have no text."""

    _asked: object

    @property
    def shapes(self) -> list[HeldShape]:
        return self._asked.shapes if isinstance(self._asked, Shaped) else []

    @shapes.setter
    def shapes(self, shapes: list[HeldShape]) -> None:
        if isinstance(self._asked, Shaped):
            self._asked.shapes = shapes


def hand_on(earlier: object, later: object) -> None:
    """Have a conversation know the shapes that one before it on its link has learned: a plug that was pulled changes
    no gauge, and one whose in/mm was pressed meanwhile is noticed."""
    if isinstance(earlier, Shaped) and isinstance(later, Shaped):
        later.shapes = earlier.shapes


def _in_words(shape: Shape) -> str:
    numbers = f", {shape.fields} to a message" if shape.fields > 1 else ""
    return f"{shape.width} characters with {shape.decimals} decimals{numbers}"


def _number(text: bytes) -> float:
    return float(text.replace(b" ", b""))


def _with_another(text: bytes, least: float) -> Iterator[float]:
    """The numbers of which one false digit makes this text, of those digits that stand for at least so much."""
    point = text.index(b".")
    for k, byte in enumerate(text):
        stands_for = 10.0 ** (point - k - (k < point))
        for digit in _DIGITS if byte in _DIGITS and stands_for >= least else b"":
            yield _number(text[:k] + bytes([digit]) + text[k + 1 :])


_NUMBER = re.compile(r"[+-]?(\d{1,18}(\.\d{0,18})?|\.\d{1,18})([eE][+-]?\d{1,2})?", re.ASCII)
_MAX_DEG = 1e6
"""No axis turns further from its zero."""
_LARGEST_BESIDE = 1e9
"""No speed in percent, no mass, no temperature and no program's number is larger."""


def number(text: str) -> float | None:
    """Return a decimal number, None for anything else (nan, inf, hexadecimals, underscores, a hundred digits)."""
    return float(text) if _NUMBER.fullmatch(text) else None


def are_angles(values_deg: Iterable[float]) -> bool:
    """Return whether all values are finite and possible for an axis."""
    return all(abs(value) < _MAX_DEG for value in values_deg)


def plausible(value: float) -> float:
    """Return what a robot shows beside its joints; nan for what no speed, mass, temperature or program can be."""
    return value if abs(value) <= _LARGEST_BESIDE else math.nan


_LEAST_MM = 1e-20
"""What is left where double precision takes lengths of 0.1 mm from each other is some 1e-17 or nothing at all."""


def is_length(value_mm: float) -> bool:
    """Return whether a number can be a length that was measured; nan and infinity cannot."""
    return value_mm == 0 or _LEAST_MM < abs(value_mm) <= LONGEST_MM


def refusal(value_mm: float, gauge: Probe) -> tuple[FaultKind, str] | None:
    """Return why the number is not a reading of this gauge, and what to check; None where it can be one."""
    if not is_length(value_mm):
        return FaultKind.GARBLED, f"{value_mm:.3g} mm is no length that a gauge measures; check `units`"
    if gauge.limits_mm is None or gauge.limits_mm[0] <= value_mm <= gauge.limits_mm[1]:
        return None
    lowest_mm, highest_mm = gauge.limits_mm
    where = f"a reading outside its range_mm, {lowest_mm:g} to {highest_mm:g} mm"
    return FaultKind.DEVICE_ERROR, f"{where}; move the probe into its range, or correct `range_mm` or `units`"
