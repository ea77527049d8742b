"""Noise-free readings of an arm in a program and a set-up, and their derivatives by joints and ball.

A program is computed once on a fine regular time grid and sampled at the reading times of a run, so the computing time
is independent of the rate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tests.worlds.stranger.cell import Cell
from tests.worlds.stranger.faults import Fault
from tests.worlds.stranger.gauges import Link
from tests.worlds.stranger.measure import by_ball, by_joint, measure, tool_of, trace_of
from tests.worlds.stranger.motion import Motion, Track, lap
from tests.worlds.stranger.screws import Array

GRID_S = 0.01

BY_RUN = ("vibration", "gauge_scale", "gauge_inclination", "gauge_cyclic")
"""Effects applied per run: a vibration has a random phase, and a gauge error depends on the reading, which includes
the scatter of the run. A sticking gauge stays in the program, because it depends on the motion between readings.
"""


@dataclass(frozen=True)
class Program:
    """Readings (m, k) mm at the rows of the motion, with its faults except those of `BY_RUN`; by_joint (m, k, 6)
    mm/rad; by_ball (m, k, 3). The rows of a circle are its regular grid, those of targets the stops.
    """

    motion: Motion
    readings: Array
    by_joint: Array
    by_ball: Array

    @property
    def t_s(self) -> Array:
        return self.motion.t[self.motion.rows]

    @property
    def q(self) -> Array:
        return self.motion.q[self.motion.rows]


def circle(cell: Cell, track: Track, test: str, sense: int, laps: int) -> Motion:
    """A run of laps on a regular grid."""
    return lap(cell, track, test, sense, np.arange(0.0, 3600.0, GRID_S), GRID_S, laps)


def program(cell: Cell, motion: Motion, link: Link, faults: Sequence[Fault]) -> Program:
    """Compute a motion with faults, except those of `BY_RUN`, which are applied per run."""
    trace = trace_of(cell, motion)
    steady = [fault for fault in faults if fault.effect not in BY_RUN]
    return Program(
        motion,
        measure(cell, motion, steady, link, trace=trace),
        by_joint(cell, motion, link, trace),
        by_ball(motion, link, tool_of(cell, motion, [], trace)),
    )


def at(t: Array, columns: Array) -> Array:
    """Interpolate columns (n, …) of the regular grid at t (m,) s, by cubics through four neighbours."""
    x = np.clip(t / GRID_S, 0, len(columns) - 1)
    k = np.clip(x.astype(int), 1, len(columns) - 3)
    u = (x - k).reshape(-1, *[1] * (columns.ndim - 1))
    found: Array = (
        -u * (u - 1) * (u - 2) / 6 * columns[k - 1]
        + (u + 1) * (u - 1) * (u - 2) / 2 * columns[k]
        - (u + 1) * u * (u - 2) / 2 * columns[k + 1]
        + (u + 1) * u * (u - 1) / 6 * columns[k + 2]
    )
    return found
