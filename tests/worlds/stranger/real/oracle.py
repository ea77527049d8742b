"""An oracle for a realistic cell: visibility of faults in tests with this noise, and indistinguishable names.

It knows the signatures of the generator, the noise of every run and the healthy background at full size, more than any
diagnosis can know. The repeatability test is omitted, because it visits targets of the hemisphere again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from tests.worlds.stranger.faults import Fault, healthy_of
from tests.worlds.stranger.measure import measure
from tests.worlds.stranger.real.noise import CellNoise, Levels, along_lap
from tests.worlds.stranger.real.setups import centred, watched
from tests.worlds.stranger.screws import Array
from tests.worlds.stranger.sight import REPEATS, Sight, View, flat, setup_rows, view_by_ball

SEEN = 7.0
"""Sigma above which a fault is testable."""
TWIN = 3.0
"""Sigma below which a fitted rival is indistinguishable."""
_TO_CHANNELS = np.array([[0.5, 0.5], [-1.0, 1.0]])


@dataclass(frozen=True)
class Seen:
    """Visibility of a fault. sigma: against noise, set-ups, healthy background and the other faults with free sizes;
    twins: names that explain it equally well.
    """

    sigma: float
    twins: tuple[str, ...]

    @property
    def testable(self) -> bool:
        return self.sigma >= SEEN


class _Centred(Sight):
    """Signatures computed with the ball mounted anew, as an operator does."""

    def __init__(self, day: Sight) -> None:
        self.__dict__.update(day.__dict__)
        self._watches = [watched(self.cell, view.motion, view.trace, view.link) for view in self.views]

    def signature(self, faults: Sequence[Fault], exact: bool = False) -> list[Array]:
        if not exact:
            return super().signature(faults)
        found = []
        links = {}
        for view, watch in zip(self.views, self._watches, strict=True):
            test = view.motion.test
            if test not in links:
                own = [w for w in self._watches if w.motion.test == test]
                links[test] = centred(self.cell, own, view.link, faults)
            found.append(measure(self.cell, view.motion, faults, links[test], trace=view.trace) - watch.plain)
        return found


class Oracle:
    """Lengths and angles between signatures in the true noise of a cell; levels by test."""

    def __init__(self, sight: Sight, noise: CellNoise, levels: Mapping[str, Levels], visits: int, laps: int) -> None:
        self.sight = _Centred(sight)
        self._covariances = [_covariances(sight, view, noise, levels, laps) for view in sight.views]
        self._precision_roots = [
            np.linalg.cholesky(sum(np.linalg.inv(C) for C in runs) * (visits if len(runs) == 1 else 1))
            for runs in self._covariances
        ]
        self.names, library = sight.library
        self._raw_setup = np.linalg.qr(setup_rows(sight).T)[0].T
        self._Q = np.linalg.qr(self._unit(setup_rows(sight)).T)[0].T
        self.library = self.whiten(library)

    def frame(self, level: float, apart: Sequence[str] = ()) -> Frame:
        """Scales with a healthy background of `level` times its standard deviation, without the names `apart`."""
        share = np.array([0.0 if name in apart else level for name in self.names])
        counts = np.array([self.names.count(name) for name in self.names])
        return Frame(self, (self.library * (share / np.sqrt(counts))[:, None])[share > 0])

    def whiten(self, rows: Array) -> Array:
        """Convert raw rows (n, D) to unit noise, without the part absorbed by the set-up."""
        unit = self._unit(rows)
        return unit - (unit @ self._Q.T) @ self._Q

    def _unit(self, rows: Array) -> Array:
        out, start = np.empty_like(rows), 0
        for root in self._precision_roots:
            stop = start + len(root)
            out[:, start:stop] = rows[:, start:stop] @ root
            start = stop
        return out

    def scatter_mm(self) -> dict[str, float]:
        """Return by test the rms difference between two runs divided by root two, in mm per channel."""
        found: dict[str, list[float]] = {}
        for view, runs in zip(self.sight.views, self._covariances, strict=True):
            found.setdefault(view.motion.test, []).extend(float(np.mean(np.diag(C))) for C in runs)
        return {test: float(np.sqrt(np.mean(squares))) for test, squares in found.items()}

    def moves_mm(self, faults: Sequence[Fault]) -> dict[str, float]:
        """Return by test the rms change by faults after fitting the set-ups, in mm per channel (mean and difference
        of the gauges).
        """
        x = flat(self.sight.signature(faults, exact=True))
        x = x - (x @ self._raw_setup.T) @ self._raw_setup
        squares: dict[str, list[Array]] = {}
        start = 0
        for view, root in zip(self.sight.views, self._precision_roots, strict=True):
            squares.setdefault(view.motion.test, []).append(x[start : start + len(root)] ** 2)
            start += len(root)
        return {test: float(np.sqrt(np.mean(np.concatenate(parts)))) for test, parts in squares.items()}

    def look(self, faults: Sequence[Fault], level: float) -> list[Seen]:
        """Visibility of each fault, with a healthy background of `level` times its standard deviation."""
        frame = self.frame(level, [fault.name for fault in faults])
        rows = np.array([frame.of([fault]) for fault in faults])
        alone = 1 / np.sqrt(np.maximum(np.diag(np.linalg.pinv(rows @ rows.T)), 1e-30))
        return [_seen(frame, fault, x, float(sigma)) for fault, x, sigma in zip(faults, rows, alone, strict=True)]

    def unexplained(self, fault: Fault, level: float) -> float:
        """Sigma of a foreign fault unexplained by any single name."""
        frame = self.frame(level)
        x = frame.of([fault])
        alike = max(frame.likeness(x).values())
        return float(np.linalg.norm(x)) * float(np.sqrt(max(0.0, 1 - alike**2)))


class Frame:
    """Signatures x as W x with W'W = (1 + U U')^-1, so their lengths are in sigma."""

    def __init__(self, oracle: Oracle, U: Array) -> None:
        self.oracle, self._U = oracle, U
        square, V = np.linalg.eigh(U @ U.T)
        square = np.maximum(square, 1e-30)
        self._middle = (V * ((1 - 1 / np.sqrt(1 + square)) / square)) @ V.T

    def seen(self, rows: Array) -> Array:
        """Convert rows (n, D) of unit noise to sigma."""
        return rows - (rows @ self._U.T) @ self._middle @ self._U

    def of(self, faults: Sequence[Fault]) -> Array:
        """Signature (D,) of faults in sigma."""
        return self.seen(self.oracle.whiten(flat(self.oracle.sight.signature(faults, exact=True))[None]))[0]

    @cached_property
    def library(self) -> dict[str, Array]:
        """Return by name all possible appearances (looks, D) in sigma."""
        seen, names = self.seen(self.oracle.library), self.oracle.names
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


def _seen(frame: Frame, fault: Fault, x: Array, sigma: float) -> Seen:
    if fault.effect == "link_geometry":
        # Linearised like the library; otherwise second-order parts of 13 mm separate an exact twin by 50 sigma.
        small = replace(fault, size=healthy_of(fault.effect, fault.keys))
        x = frame.of([small]) * fault.size / small.size
    size = float(np.linalg.norm(x))
    twins = [
        name
        for name, cosine in frame.likeness(x).items()
        if name != fault.name and size * np.sqrt(max(0.0, 1 - cosine**2)) < TWIN
    ]
    return Seen(sigma, tuple(sorted(twins)))


def _covariances(sight: Sight, view: View, noise: CellNoise, levels: Mapping[str, Levels], laps: int) -> list[Array]:
    """Covariance (k m, k m) mm² of each run of a program in the order of `flat`: channels one after the
    other.
    """
    own = levels[view.motion.test]
    t = view.motion.t[view.motion.rows]
    step = noise.resolution_mm**2 / 12
    smooth = along_lap(2 * np.pi * t / t[-1])
    ball = view_by_ball(sight.cell, view)
    shared = {
        (a, b): (np.radians(own.joints_deg) ** 2 * view.by_joint[:, a] @ view.by_joint[:, b].T
                 + own.ball_mm**2 * ball[:, a] @ ball[:, b].T) * (smooth @ smooth.T)
        for a in range(view.plain.shape[1]) for b in range(view.plain.shape[1])
    }  # fmt: skip
    if view.motion.test == "radial":
        stops = np.array([own.stops_mm[int(k)] for k in view.motion.labels["target"]]) if view.motion.labels else 0.0
        stopped = stops**2 / 3 * (ball[:, 0] ** 2).sum(axis=1)
        single = own.white_mm[0, 0] ** 2 + own.slow_mm[0] ** 2 + step
        return [shared[0, 0] + np.diag(single + stopped)]
    more = max(1.0, noise.rate_hz * float(np.median(np.diff(t)))) * laps
    wander = slow_covariance(np.abs(t[:, None] - t), own.slow_s) / laps
    first = 0 if view.motion.sense > 0 else REPEATS
    runs = []
    for run in range(first, first + REPEATS):
        blocks = {}
        for (a, b), scatter in shared.items():
            share = 1.0 if a == b else own.common
            blocks[a, b] = scatter + own.slow_mm[run] ** 2 * share * wander
            if a == b:
                blocks[a, b] = blocks[a, b] + (own.white_mm[run, a] ** 2 + step) / more * np.eye(len(t))
        runs.append(_in_channels(blocks))
    return runs


def _in_channels(blocks: dict[tuple[int, int], Array]) -> Array:
    """Convert covariances of two gauges to those of their mean and difference."""
    T = _TO_CHANNELS
    n = len(blocks[0, 0])
    covariance = np.array([[blocks[a, b] for b in range(2)] for a in range(2)])
    return np.einsum("ca,db,abmn->cmdn", T, T, covariance, optimize=True).reshape(2 * n, 2 * n)


def slow_covariance(lag_s: Array, tau_s: float) -> Array:
    """Covariance of slow noise of unit variance: AR(1), or the 1/f spectrum of `noise.slow` if tau_s is
    zero.
    """
    if tau_s:
        return np.exp(-lag_s / tau_s)
    f = np.arange(1, 4000) * 0.0125
    power = 1 / np.maximum(f, 0.05)
    grid = np.linspace(0.0, float(lag_s.max()) + 1e-9, 400)
    shape = np.cos(2 * np.pi * grid[:, None] * f) @ power / power.sum()
    return np.interp(lag_s, grid, shape)
