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
from tests.worlds.stranger.measure import measure, trace_of
from tests.worlds.stranger.motion import Motion, lap, targets, track_of, visits
from tests.worlds.stranger.names import everything, looks
from tests.worlds.stranger.noise import Noise
from tests.worlds.stranger.screws import Array

REPEATS = 3
_STEP_RAD = 1e-6
LEAST_SNR = 7.0
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
        columns = []
        for joint in range(6):
            turned = measure(self.cell, motion, [], link, _STEP_RAD * np.eye(6)[joint], trace=trace)
            columns.append((turned - plain) / _STEP_RAD)
        return View(motion, link, trace, plain, np.stack(columns, axis=2))

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
        return [self._quick(faults[0], view) if quick else self._exact(faults, view) for view in self.views]

    def _quick(self, fault: Fault, view: View) -> Array:
        deviation = ON_JOINT[fault.effect](fault, view.trace)[view.motion.rows]
        return view.by_joint[:, :, joint_of(fault)] * deviation[:, None]

    def _exact(self, faults: Sequence[Fault], view: View) -> Array:
        return measure(self.cell, view.motion, faults, view.link, trace=view.trace) - view.plain

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


class Scales:
    """Lengths and angles between signatures in units of noise, scatter, free set-up and background."""

    def __init__(self, sight: Sight, noise: Noise) -> None:
        self.sight, self.noise = sight, noise
        self._roots = [self._root(view) for view in sight.views]
        self.names, library = sight.library
        self._Q = np.linalg.qr(self._unit(setup_rows(sight)).T)[0].T
        self.scatter = self.whiten(self._scatter())
        self.library = self.whiten(library)

    def limits(self) -> dict[str, float]:
        """Return by name the size, in healthy sizes, with SNR 7 against noise and scatter only, for its median
        shape.
        """
        length = np.linalg.norm(self.frame({}).seen(self.library), axis=1)
        return {
            name: float(LEAST_SNR / max(np.median(length[self._of(name)]), 1e-9)) for name in dict.fromkeys(self.names)
        }

    def frame(self, background: Mapping[str, float], apart: Sequence[str] = ()) -> Frame:
        """Scales with a background that excludes the names `apart`.

        background: standard deviation of the size by name, in healthy sizes.
        """
        share = np.array([0.0 if name in apart else background.get(name, 0.0) for name in self.names])
        counts = np.array([self.names.count(name) for name in self.names])
        rows = self.library * (share / np.sqrt(counts))[:, None]
        return Frame(self, np.concatenate([self.scatter, rows[share > 0]]))

    def whiten(self, rows: Array) -> Array:
        """Convert raw rows (n, D) to unit noise, without the part absorbed by the set-up."""
        unit = self._unit(rows)
        return unit - (unit @ self._Q.T) @ self._Q

    def _of(self, name: str) -> list[int]:
        return [k for k, other in enumerate(self.names) if other == name]

    def _unit(self, rows: Array) -> Array:
        out, start = np.empty_like(rows), 0
        for view, roots in zip(self.sight.views, self._roots, strict=True):
            m = len(view.motion.rows)
            for root in roots:
                block = rows[:, start : start + m]
                out[:, start : start + m] = block / root if root.ndim == 1 else block @ root
                start += m
        return out

    def _root(self, view: View) -> list[Array]:
        """Return per channel the transposed inverse Cholesky factor of its noise (m, m), or sd (m,) for single
        targets.
        """
        t, noise = view.motion.t[view.motion.rows], self.noise
        if view.motion.test == "radial":
            return [np.full(len(t), np.hypot(noise.white, noise.wander))]
        wander = noise.wander**2 * np.exp(-np.abs(t[:, None] - t) / noise.wander_s)
        white = noise.white**2 * np.eye(len(t)) / max(1.0, noise.rate_hz * float(np.median(np.diff(t))))
        mean, difference = 0.95 * wander + white / 2, 0.2 * wander + 2 * white
        return [np.linalg.inv(np.linalg.cholesky(C / REPEATS)).T for C in (mean, difference)]

    def _scatter(self) -> Array:
        shapes = [np.zeros_like(view.plain) for view in self.sight.views]
        scatter = []
        for k, view in enumerate(self.sight.views):
            runs = np.sqrt(1 if view.motion.test == "radial" else REPEATS)
            off, ball = np.radians(self.noise.joints_deg) / runs, by_ball(self.sight.cell, view)
            scatter += [_placed(shapes, {k: off * view.by_joint[:, :, j]}) for j in range(6)]
            scatter += [_placed(shapes, {k: self.noise.ball_mm / runs * ball[:, :, c]}) for c in range(3)]
        return np.array(scatter)


def setup_rows(sight: Sight) -> Array:
    """Changes (n, D) mm of the readings by the set-ups: a ball and gauge zeros for each test."""
    views, ball = sight.views, [by_ball(sight.cell, view) for view in sight.views]
    shapes = [np.zeros_like(view.plain) for view in views]
    setup = []
    for test in ("yaw", "roll", "radial"):
        members = [k for k, view in enumerate(views) if view.motion.test == test]
        setup += [_placed(shapes, {k: ball[k][:, :, c] for k in members}) for c in range(3)]
        gauges = np.eye(shapes[members[0]].shape[1])
        setup += [_placed(shapes, {k: shapes[k] + gauge for k in members}) for gauge in gauges]
    return np.array(setup)


def by_ball(cell: Cell, view: View) -> Array:
    """Derivatives (m, k, 3) of the readings by the ball position."""
    columns = []
    for step in 1e-4 * np.eye(3):
        link = Link(view.link.ball + step, view.link.zeros, view.link.at)
        columns.append((measure(cell, view.motion, [], link, trace=view.trace) - view.plain) / 1e-4)
    return np.stack(columns, axis=2)


def _placed(shapes: list[Array], parts: dict[int, Array]) -> Array:
    return flat([parts.get(k, shape) for k, shape in enumerate(shapes)])


class Frame:
    """Signatures x as W x with W'W = (1 + U U')^-1, so their lengths are in sigma."""

    def __init__(self, scales: Scales, U: Array) -> None:
        self.scales, self._U = scales, U
        square, V = np.linalg.eigh(U @ U.T)
        square = np.maximum(square, 1e-30)
        self._middle = (V * ((1 - 1 / np.sqrt(1 + square)) / square)) @ V.T

    def seen(self, rows: Array) -> Array:
        """Convert rows (n, D) of unit noise to sigma."""
        return rows - (rows @ self._U.T) @ self._middle @ self._U

    def of(self, faults: Sequence[Fault]) -> Array:
        """Signature (D,) of faults in sigma."""
        scales = self.scales
        return self.seen(scales.whiten(flat(scales.sight.signature(faults, exact=True))[None]))[0]

    @cached_property
    def library(self) -> dict[str, Array]:
        """Return by name all possible appearances (looks, D) in sigma."""
        seen, names = self.seen(self.scales.library), self.scales.names
        return {name: seen[[other == name for other in names]] for name in dict.fromkeys(names)}

    def likeness(self, x: Array) -> dict[str, float]:
        """Return by name the similarity of x (D,) to its best appearance: a cosine, 0 … 1."""
        size = float(np.linalg.norm(x))
        return {
            name: max(_cosine(x, look) for look in _looks(name, rows)) / size for name, rows in self.library.items()
        }


def _looks(name: str, rows: Array) -> list[Array]:
    """Return bases (k, D): sine and cosine are combined, and so are the shapes between two ends."""
    apart = name.split(maxsplit=1)[0] in ("transmission_error", "ball_form", "gauge_cyclic", "vibration")
    return [rows[k : k + 2] for k in range(0, len(rows), 2)] if apart else [rows]


def _cosine(x: Array, rows: Array) -> float:
    """Length of the projection of x onto the span of rows, using well-conditioned directions only."""
    gram = rows @ rows.T
    value, V = np.linalg.eigh(gram)
    good = value > 1e-8 * value[-1] + 1e-12
    coordinates = (V[:, good].T @ (rows @ x)) / np.sqrt(value[good])
    return float(np.linalg.norm(coordinates))
