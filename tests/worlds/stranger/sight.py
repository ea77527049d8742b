"""Visibility in the tests of a case: signatures of effects, and their size relative to everything else.

A signature is the difference between measurements with and without a fault. It is weighted by the noise of all repeats,
with the set-up (ball and zeros of each test) projected out, and with the scatter of runs and the background as
additional noise U U'. The length of a signature is therefore its matched-filter SNR, and the cosine between two is
their similarity.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from tests.worlds.stranger.cell import Cell, read_cell
from tests.worlds.stranger.faults import Fault
from tests.worlds.stranger.gauges import Link
from tests.worlds.stranger.joints import ON_JOINT, Trace, joint_of
from tests.worlds.stranger.measure import by_ball, by_joint, measure, tool_of, trace_of
from tests.worlds.stranger.motion import Motion, lap, targets, track_of, visits
from tests.worlds.stranger.names import everything, looks
from tests.worlds.stranger.screws import Array

REPEATS = 3
_BY_SETUP = ("time_lag", "clock_rate", "gauge_scale", "gauge_inclination", "gauge_baseline", "gauge_cyclic",
             "gauge_dead_band", "ball_form", "link_geometry")  # fmt: skip
"""Effects visible only through changes of the readings, so they depend on the eccentricity of the set-up. Lengths
along parallel axes are indistinguishable around one ball, but not around another.
"""


@dataclass(frozen=True)
class View:
    """A program: motion, set-up, and derivatives (m, k, 6) mm/rad of the readings (m, k) by each joint."""

    motion: Motion
    link: Link
    trace: Trace
    plain: Array
    by_joint: Array


class Sight:
    """The programs of a robot's case with a reading per degree, and the signatures of the complete vocabulary."""

    def __init__(self, cell: Cell) -> None:
        self.cell = cell
        track = track_of(cell, cell.circle)
        at = np.cumsum(np.random.default_rng(1).uniform(0.03, 0.08, 600))
        circles = [lap(cell, track, test, sense, at, 0.03) for test in ("yaw", "roll") for sense in (1, -1)]
        reached = targets(cell)
        order = np.random.default_rng(2).permutation(len(reached["q"]))
        stops = visits(cell, reached, order, np.full(len(order), 2.5))
        self.track, self.targets = track, reached
        self.views = [self._view(motion) for motion in [*circles, stops]]

    def _view(self, motion: Motion) -> View:
        zeros = np.zeros(1 if motion.test == "radial" else 2)
        link = Link(motion.place.centre + np.array([0.4, -0.3, 0.2]), zeros, self.cell.gauge_at)
        trace = trace_of(self.cell, motion)
        plain = measure(self.cell, motion, [], link, trace=trace)
        return View(motion, link, trace, plain, by_joint(self.cell, motion, link, trace))

    def placed(self, links: Mapping[str, Link]) -> Sight:
        """Same programs with the set-ups of a day, by test.

        The eccentricity of the ball determines the visibility of lags and gauge scales. Only these signatures are
        recomputed.
        """
        day = copy(self)
        day.views = [
            replace(view, link=link, plain=measure(self.cell, view.motion, [], link, trace=view.trace))
            for view in self.views
            for link in [links[view.motion.test]]
        ]
        names, rows = self.library
        faults = [fault for effect, keys in everything() for fault in looks(effect, keys)]
        again = [k for k, fault in enumerate(faults) if fault.effect in _BY_SETUP]
        rows = rows.copy()
        rows[again] = [flat(day.signature([faults[k]])) for k in again]
        day.library = names, rows
        return day

    def signature(self, faults: Sequence[Fault], exact: bool = False) -> list[Array]:
        """Return readings with faults minus those without, (m, k) mm per program; joints to first order unless
        `exact`.
        """
        quick = len(faults) == 1 and faults[0].effect in ON_JOINT and not exact
        if quick:
            return [self._quick(faults[0], view) for view in self.views]
        return [
            measure(self.cell, view.motion, faults, view.link, trace=view.trace) - view.plain for view in self.views
        ]

    def _quick(self, fault: Fault, view: View) -> Array:
        deviation = ON_JOINT[fault.effect](fault, view.trace)[view.motion.rows]
        return view.by_joint[:, :, joint_of(fault)] * deviation[:, None]

    @cached_property
    def library(self) -> tuple[list[str], Array]:
        """Return names and raw signatures (columns, D) of every shape of every name, at healthy sizes."""
        faults = [fault for effect, keys in everything() for fault in looks(effect, keys)]
        return [fault.name for fault in faults], np.array([flat(self.signature([fault])) for fault in faults])


@lru_cache(maxsize=4)
def sight_of(robot: str) -> Sight:
    """Cached visibility of a shipped robot on its own circle."""
    return Sight(read_cell(robot))


def flat(parts: list[Array]) -> Array:
    """Return mean and difference of the gauges, program by program, as a vector (D,)."""
    return np.concatenate([_channels(part).ravel() for part in parts])


def _channels(part: Array) -> Array:
    """Return channels (channels, m): mean and difference of two gauges have independent noise."""
    return part.T if part.shape[1] == 1 else np.stack([part.mean(axis=1), part[:, 1] - part[:, 0]])


def setup_rows(sight: Sight) -> Array:
    """Changes (n, D) mm of the readings by the set-ups: a ball and gauge zeros for each test."""
    views, ball = sight.views, [view_by_ball(sight.cell, view) for view in sight.views]
    shapes = [np.zeros_like(view.plain) for view in views]
    setup = []
    for test in ("yaw", "roll", "radial"):
        members = [k for k, view in enumerate(views) if view.motion.test == test]
        setup += [_placed(shapes, {k: ball[k][:, :, c] for k in members}) for c in range(3)]
        gauges = np.eye(shapes[members[0]].shape[1])
        setup += [_placed(shapes, {k: shapes[k] + gauge for k in members}) for gauge in gauges]
    return np.array(setup)


def view_by_ball(cell: Cell, view: View) -> Array:
    """Derivatives (m, k, 3) of the readings by the position of the ball."""
    return by_ball(view.motion, view.link, tool_of(cell, view.motion, [], view.trace))


def _placed(shapes: list[Array], parts: dict[int, Array]) -> Array:
    return flat([parts.get(k, shape) for k, shape in enumerate(shapes)])
