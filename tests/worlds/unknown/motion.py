"""Paths of an arm: stops at poses, and circles at constant speed; rad, s."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from tests.worlds.unknown.arms import Array

MOVE_SAMPLES = 8
"""Samples of a move between two stops, where torques and angles are smooth."""
SPEED_RAD_S = np.radians(30.0)
STOP_S = 6.0
"""Time for settling and reading at a stop."""
FINE_S = 0.02


@dataclass(frozen=True)
class Motion:
    """A path t (n,) s, q (n, axes) rad, with the rows (m,) of the readings. phi (n,) rad: circle angle, otherwise
    zeros; sense: +1 or -1 for a circle, otherwise 0.
    """

    t: Array
    q: Array
    rows: NDArray[np.int64]
    phi: Array
    sense: int = 0

    @property
    def t_read(self) -> Array:
        return self.t[self.rows]

    @property
    def q_read(self) -> Array:
        return self.q[self.rows]


def stops(q: Array, begin_s: float = 0.0) -> Motion:
    """Visit postures q (m, axes) one after another with smooth synchronous joint moves."""
    share = (1 - np.cos(np.pi * np.arange(1, MOVE_SAMPLES + 1) / MOVE_SAMPLES)) / 2
    path, times, rows, now = [q[0]], [begin_s], [0], begin_s
    for last, following in pairwise(q):
        seconds = max(1.0, float(np.abs(following - last).max()) / SPEED_RAD_S)
        path += list(last + share[:, None] * (following - last))
        times += list(now + STOP_S + seconds * np.arange(1, MOVE_SAMPLES + 1) / MOVE_SAMPLES)
        now += STOP_S + seconds
        rows.append(len(path) - 1)
    return Motion(np.array(times), np.array(path), np.array(rows), np.zeros(len(path)))


def lap(q: Array, phi: Array, sense: int, lap_s: float, begin_s: float, rate_hz: float) -> Motion:
    """Drive a circle with lead-in and lead-out; q (k, axes): joints at the angles phi (k,) rad."""
    arc = float(phi[-1] - phi[0])
    seconds = lap_s * arc / (2 * np.pi)
    t = np.arange(0.0, seconds, FINE_S)
    at = phi[0] + t / seconds * arc if sense > 0 else phi[-1] - t / seconds * arc
    joints = np.asarray(CubicSpline(phi, q)(at))
    rows = np.arange(0, len(t), max(1, round(1 / (rate_hz * FINE_S))))
    return Motion(begin_s + t, joints, rows, at, sense)
