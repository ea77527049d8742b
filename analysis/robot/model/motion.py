"""Joint reversals, which hysteresis depends on."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from analysis.robot.kinematics.arm import Arm, Array, Integers, drive_angles
from rigs.schema.scene import play

_TURN_RAD = np.radians(0.003)
"""Smaller changes are encoder noise, not reversals."""
_STANDSTILL_S = 0.1
"""Window for a standstill: the robot is at rest if all joints turn by less than encoder noise within this time.
Every program is faster."""
_INSTANT_S = 1e-6
"""Rounding error of a time."""
_NEAR_S = 0.25
_LEAST = 5
_NONE: Integers = np.empty(0, dtype=np.intp)


@dataclass(frozen=True, eq=False)
class Motion:
    """Reported angles q (n, axes) rad at times t_s (n,). Joint reversals are computed once and shared.

    samples_per_visit: 0 for a single trace in order of time. Otherwise every group of this size is a separate visit:
    the time between visits and their order are unknown.
    """

    t_s: Array
    q: Array
    samples_per_visit: int = 0
    _reversals: dict[int, list[tuple[float, float]]] = field(default_factory=dict, init=False, repr=False)
    _of_drives: dict[bytes, Motion] = field(default_factory=dict, init=False, repr=False)

    def of_drives(self, arm: Arm) -> Motion:
        """Motion of the drives of an arm, with their angles and reversals in place of the reported ones."""
        if arm.drives is None:
            return self
        key = arm.to_drives.tobytes()
        if key not in self._of_drives:
            self._of_drives[key] = replace(self, q=drive_angles(arm, self.q))
        return self._of_drives[key]

    def reversals(self, axis: int) -> list[tuple[float, float]]:
        if self.samples_per_visit:
            return []
        if axis not in self._reversals:
            self._reversals[axis] = turns(self.t_s, self.q[:, axis - 1], self._stand_ends)
        return self._reversals[axis]

    @cached_property
    def _stand_ends(self) -> Integers:
        ends = [end - 1 for _, end in standing(self.t_s, self.q, _TURN_RAD, _STANDSTILL_S) if end < len(self.t_s)]
        return np.array(ends, dtype=np.intp)


def standing(t_s: Array, q: Array, still_rad: float, window_s: float) -> list[tuple[int, int]]:
    """Rows [begin, end) of each standstill: all joints move by less than still_rad within window_s.

    Times t_s (n,) s, reported angles q (n, 6) rad. The standstills do not overlap.
    """
    rows = np.arange(len(t_s))
    ahead = np.searchsorted(t_s, t_s + window_s - _INSTANT_S).clip(max=len(t_s) - 1)
    # A robot that reverses with no stop returns to the same position, but moves in between.
    moved = np.maximum(np.abs(q[ahead] - q), np.abs(q[(rows + ahead) // 2] - q)).max(axis=1)
    still = (moved < still_rad) & (t_s[ahead] - t_s >= 0.9 * window_s)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], still.astype(int), [0]])))
    periods: list[tuple[int, int]] = []
    for begin, last in edges.reshape(-1, 2).tolist():
        end = int(ahead[last - 1]) + 1
        if periods and begin < periods[-1][1]:
            periods[-1] = (periods[-1][0], end)
        else:
            periods.append((begin, end))
    return periods


def turns(t_s: Array, x: Array, stand_ends: Integers = _NONE) -> list[tuple[float, float]]:
    """Reversals of x (n,) rad: time in s, and new direction (±1).

    stand_ends (s,): last row of each standstill of the robot. A reversal in a standstill happens at the departure;
    otherwise it happens at the vertex of the motion.
    """
    follower = play(x, _TURN_RAD / 2)
    moving = np.flatnonzero(np.diff(follower))
    direction = np.sign(np.diff(follower)[moving])
    changes = np.append(np.flatnonzero(np.diff(x)), len(x) - 1)
    reversals = []
    for k in np.flatnonzero(np.diff(direction)):
        # The follower resumes only after the gap; the reversal itself was at the previous extreme.
        between = slice(moving[k], moving[k + 1] + 1)
        extreme = moving[k] + int(np.argmin(direction[k + 1] * x[between]))
        last = int(changes[np.searchsorted(changes, extreme)])
        # A joint may rest after the departure of the robot while other joints turn.
        leaves = np.searchsorted(t_s, t_s[moving[k + 1]] - 2 * _NEAR_S)
        ended = stand_ends[(stand_ends >= max(moving[k], leaves)) & (stand_ends <= moving[k + 1] + 1)]
        if len(ended):
            when = t_s[ended[-1]]
        elif len(_near(t_s, extreme)) < _LEAST:
            when = t_s[last]  # At a program stop the joint reverses at the departure.
        else:
            # Between samples: the vertex of a parabola through the samples around the extreme, which rounding may
            # flatten. If there is no parabola, as around a stop, the extreme itself is sufficient.
            middle = (extreme + last) // 2
            near = _near(t_s, middle)
            since = t_s[near] - t_s[middle]
            bend, slope, _ = np.polyfit(since, x[near] - x[middle], 2)
            shift = -slope / (2 * bend) if bend else np.inf
            when = t_s[middle] + shift if abs(shift) <= 2 * np.max(np.diff(since)) else t_s[middle]
        reversals.append((float(when), float(direction[k + 1])))
    return reversals


def _near(t_s: Array, k: int) -> Integers:
    """Indices of samples with times t_s (n,) s close to the time of sample k."""
    first, end = np.searchsorted(t_s, t_s[k] + 2 * _NEAR_S * np.array([-1, 1]))
    near: Integers = first + np.flatnonzero(np.abs(t_s[first:end] - t_s[k]) <= _NEAR_S)
    return near
