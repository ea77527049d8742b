"""Where the value of a gauge changes from answer to answer: between two that differ it was read again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.kinematics.arm import Array, Integers, Mask

FEW = 16
"""Changes from which a period, a phase and a scatter can be determined."""
_JUMP = 4.0
"""Steps of the resolution by which a gauge on the move changes from tick to tick: by chance it repeats itself …"""
_REPEATS = 0.85
"""… in less than the rest of this share of its answers."""
_STAND = 4.0
"""The gauge stood still where so many times the usual number of answers have one value."""
_NEAR = 8


@dataclass(frozen=True)
class Bounds:
    """Changes of the value: tick in (low_ns, high_ns] (m,), shown from answer `row` (m,) on; jumps (m,): whether the
    gauge was on the move there."""

    low_ns: Array
    high_ns: Array
    row: Integers
    jumps: Mask

    def of(self, chosen: Mask) -> Bounds:
        """The changes that a mask (m,) selects."""
        return Bounds(self.low_ns[chosen], self.high_ns[chosen], self.row[chosen], self.jumps[chosen])

    @property
    def middle_ns(self) -> Array:
        """The middles (m,) of the bounds."""
        return (self.low_ns + self.high_ns) / 2

    @property
    def width_ns(self) -> Array:
        """The widths (m,) of the bounds."""
        return self.high_ns - self.low_ns

    @property
    def usual_ns(self) -> float:
        """Distance of neighbouring ticks, of those on the move."""
        lag = min(_NEAR, len(self.row) // 2)
        return float(np.quantile(self.middle_ns[lag:] - self.middle_ns[:-lag], 0.3)) / lag

    @property
    def repeating(self) -> bool:
        """Whether a gauge showed values more than once while it moved, oftener than its resolution explains."""
        runs = np.diff(self.row)[self.jumps[1:]]
        if len(runs) < FEW or self.jumps.mean() < 0.5 or self.usual_ns <= 0:
            return False
        on_the_move = runs[runs <= _STAND * np.median(runs)]
        return bool(on_the_move.mean() > 1 / _REPEATS)


def changes(asked_ns: Array, values: Array) -> Bounds:
    """Where answers at asked_ns (n,) show another value (n, k) than the one before; no number equals no number."""
    row = np.flatnonzero(_changed(values)) + 1
    with np.errstate(over="ignore"):  # readings may be as large as a double: their difference is then infinite
        steps = np.nan_to_num(np.abs(values[row] - values[row - 1])).max(axis=1, initial=0.0)
    resolution = steps[steps > 0].min(initial=np.inf)
    near = np.lib.stride_tricks.sliding_window_view(np.pad(steps, 2, mode="edge"), 5) if len(steps) else steps[:, None]
    jumps = np.median(near, axis=1) / _JUMP >= resolution
    return Bounds(asked_ns[row - 1], asked_ns[row], row, jumps)


def repeats(values: Array) -> bool:
    """Whether readings (n, k) mm stay the same so often that a cycle of their own is worth looking for."""
    return bool(np.count_nonzero(_changed(values)) < _REPEATS * len(values))


def _changed(values: Array) -> Mask:
    before, after = values[:-1], values[1:]
    return np.asarray(((before != after) & ~(np.isnan(before) & np.isnan(after))).any(axis=1))
