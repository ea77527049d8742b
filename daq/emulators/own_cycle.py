"""An instrument that measures in a cycle of its own, and answers with the last of it.

No real cycle is perfect: its crystal is off and drifts, a busy processor is late at a tick or leaves one out.
"""

from __future__ import annotations

import math
import random
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

Read = Callable[[int], Sequence[float]]

_DRIFT_S = 40.0
"""Period of the slow swing of a cycle: as long as a lap takes, so that it does not average out."""


@dataclass(frozen=True)
class Unsteady:
    """How far a cycle is from steady.

    ppm: its rate, off by up to this and swinging by half of it; jitter: each tick, by up to this share of a cycle;
    missed: share of the ticks at which nothing new is read; pace: each interval, by up to this share, the next being
    counted from there.
    """

    ppm: float = 0.0
    jitter: float = 0.0
    missed: float = 0.0
    pace: float = 0.0


STEADY = Unsteady()


class OwnCycle:
    """What an instrument with its own cycle shows: it reads at every tick and shows the mean of `length` readings."""

    def __init__(self, read: Read, cycle_ns: float, length: int, unsteady: Unsteady, chance: random.Random) -> None:
        self._read = read
        self._cycle_ns = cycle_ns
        self._unsteady = unsteady
        self._chance = chance
        self._off = chance.uniform(-unsteady.ppm, unsteady.ppm) * 1e-6
        self._latched: deque[Sequence[float]] = deque(maxlen=length)
        self._grid_ns = math.nan
        self._tick_ns = 0

    def __call__(self, now_ns: int) -> list[float]:
        """The reading at now_ns, which never falls from call to call."""
        if math.isnan(self._grid_ns):
            self._grid_ns = now_ns - (self._chance.random() + (self._latched.maxlen or 1)) * self._cycle_ns
            self._next()
            self._latched.append(self._read(self._tick_ns))
            self._next()
        while self._tick_ns <= now_ns:
            if self._chance.random() >= self._unsteady.missed:
                self._latched.append(self._read(self._tick_ns))
            self._next()
        return [sum(values) / len(self._latched) for values in zip(*self._latched, strict=True)]

    def _next(self) -> None:
        swing = 0.5e-6 * self._unsteady.ppm * math.sin(2 * math.pi * self._grid_ns / (_DRIFT_S * 1e9))
        uneven = self._chance.uniform(-self._unsteady.pace, self._unsteady.pace)
        self._grid_ns += self._cycle_ns * (1 + self._off + swing + uneven)
        jitter = self._unsteady.jitter * self._cycle_ns
        self._tick_ns = round(self._grid_ns + self._chance.uniform(-jitter, jitter))
