"""Cycle of a gauge that answers with the last reading of an internal cycle, regardless of its age.

The value changes only at a tick, so there is a tick between two different answers. While the gauge moves, an answer was
read between the first answer with its value and the answer before.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from analysis.robot.kinematics.arm import Array, Integers, Mask

_FEW = 16
"""Smallest number of changes sufficient for a period."""
_JUMP = 4.0
"""Change between readings of a moving gauge, in steps of the resolution, that makes equal readings rare."""
_REPEATS = 0.85
"""Largest fraction of changed answers that suggests an internal cycle."""
_REST_FACTOR = 4.0
"""Multiple of the usual number of equal answers above which the gauge was at rest."""
_NEAR = 8
_SAMPLE = 2000
"""Number of requests used to detect synchronisation with the cycle. More give the same result."""


@dataclass(frozen=True)
class Changes:
    """Changes of the value, with a tick in each interval (low_ns, high_ns], (m,).

    row (m,): first answer with the new value. jumps (m,): whether the gauge was moving.
    """

    low_ns: Array
    high_ns: Array
    row: Integers
    jumps: Mask

    @property
    def middle_ns(self) -> Array:
        return (self.low_ns + self.high_ns) / 2

    @property
    def usual_ns(self) -> float:
        lag = min(_NEAR, len(self.row) // 2)
        return float(np.quantile(self.middle_ns[lag:] - self.middle_ns[:-lag], 0.3)) / lag

    @property
    def repeating(self) -> bool:
        runs = np.diff(self.row)[self.jumps[1:]]
        if len(runs) < _FEW or self.jumps.mean() < 0.5 or self.usual_ns <= 0:
            return False
        on_the_move = runs[runs <= _REST_FACTOR * np.median(runs)]
        return bool(on_the_move.mean() > 1 / _REPEATS)

    def of_first_copies(self, asked_ns: Array) -> tuple[Array, Array]:
        """Times in ns of answers at asked_ns (n,), and their standard uncertainty in s.

        During motion, an answer was read when its value first appeared, otherwise within the last cycle.
        """
        copy_of = np.searchsorted(self.row, np.arange(len(asked_ns)), side="right") - 1
        seen = (copy_of >= 0) & self.jumps[np.maximum(copy_of, 0)]
        ns = np.where(seen, self.middle_ns[copy_of], asked_ns - self.usual_ns / 2)
        width_ns = np.where(seen, (self.high_ns - self.low_ns)[copy_of], self.usual_ns)
        return ns, width_ns / math.sqrt(12) / 1e9


def changes(asked_ns: Array, values: Array) -> Changes:
    """Changes of values (n, k) between consecutive answers at asked_ns (n,). NaN equals NaN."""
    row = np.flatnonzero(_changed(values)) + 1
    with np.errstate(over="ignore"):  # the difference of very large doubles is infinite
        steps = np.nan_to_num(np.abs(values[row] - values[row - 1])).max(axis=1, initial=0.0)
    resolution = steps[steps > 0].min(initial=np.inf)
    near = np.lib.stride_tricks.sliding_window_view(np.pad(steps, 2, mode="edge"), 5) if len(steps) else steps[:, None]
    jumps = np.median(near, axis=1) / _JUMP >= resolution
    return Changes(asked_ns[row - 1], asked_ns[row], row, jumps)


def repeats(values: Array) -> bool:
    return bool(np.count_nonzero(_changed(values)) < _REPEATS * len(values))


def _changed(values: Array) -> Mask:
    before, after = values[:-1], values[1:]
    return np.asarray(((before != after) & ~(np.isnan(before) & np.isnan(after))).any(axis=1))


def anywhere_in_a_cycle(asked_ns: Array, cycle_ns: float) -> tuple[Array, float]:
    """Individual (n,) and common standard uncertainty in s of readings half a cycle older than asked_ns (n,).

    If requests are synchronous with the cycle, all readings have the same age: the common part is the mean resultant
    length of the phases, maximised over cycles near the stated one.
    """
    each = asked_ns[np.linspace(0, len(asked_ns) - 1, min(len(asked_ns), _SAMPLE)).astype(int)] - asked_ns[0]
    off = np.linspace(-1e-3, 1e-3, 41)
    in_step = float(np.abs(np.exp(2j * np.pi * (1 + off[:, None]) * each / cycle_ns).mean(axis=1)).max())
    u_s = cycle_ns / math.sqrt(12) / 1e9
    return np.full(len(asked_ns), u_s * math.sqrt(1 - min(in_step, 1.0) ** 2)), u_s * in_step
