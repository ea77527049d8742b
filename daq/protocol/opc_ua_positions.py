"""Values of single axes, each with a stamp of its own, put together as positions of all six.

A server samples each axis for itself, and what it sends at once may hold several samples of an axis or only some of the
axes. Samples whose stamps lie together are one position; an axis without one then is where it was.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

_AXES = 6


@dataclass(frozen=True, slots=True)
class AxisValue:
    """A value of an axis 0 … 5. angle_deg: nan where the server calls it bad. clock_s: since 1970, nan without a stamp.
    status: 0 good, else the server's code."""

    axis: int
    angle_deg: float
    clock_s: float
    status: int = 0


@dataclass(frozen=True, slots=True)
class ArmPosition:
    """All axes at one time. apart_s: how far the stamps of the axes lie apart."""

    angles_deg: tuple[float, ...]
    clock_s: float
    status: int
    apart_s: float


class Together:
    """Collects values. together_s: stamps no further apart than this are of one position."""

    def __init__(self, together_s: float) -> None:
        self._together_s = together_s
        self._known: dict[int, AxisValue] = {}
        self._open: dict[int, AxisValue] = {}

    def take(self, values: Iterable[AxisValue]) -> Iterator[ArmPosition]:
        """Yield every position that these values complete, or that a later value shows to be complete."""
        ordered = sorted(values, key=lambda value: value.clock_s)
        if any(math.isnan(value.clock_s) for value in ordered):
            ordered = list({value.axis: value for value in ordered}.values())  # which belong together is not known
        for value in ordered:
            since_s = value.clock_s - min((begun.clock_s for begun in self._open.values()), default=value.clock_s)
            if value.axis in self._open or since_s > self._together_s:
                yield from self.end()
            self._open[value.axis] = value
            if len(self._open) == _AXES:
                yield from self.end()

    def end(self) -> Iterator[ArmPosition]:
        """Yield the position that has begun, since no more of it comes."""
        if not self._open:
            return
        stamps_s = [value.clock_s for value in self._open.values()]
        self._known |= self._open
        self._open = {}
        angles_deg = tuple(self._known[axis].angle_deg for axis in range(_AXES) if axis in self._known)
        if len(angles_deg) == _AXES and not any(map(math.isnan, angles_deg)):
            status = max(value.status for value in self._known.values())
            first_s, last_s = min(stamps_s), max(stamps_s)
            yield ArmPosition(angles_deg, (first_s + last_s) / 2, status, last_s - first_s)
