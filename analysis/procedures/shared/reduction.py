"""Reduce a run to readings at 720 circle angles per lap, without outliers and mounting slips.

rows of a run  →  outliers and bursts removed  →  least-squares polyline of each lap  →  slips removed

The cost here is linear in the rows; all later steps use 720 numbers per lap.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.robot.geometry.circle import SENSE
from analysis.robot.kinematics.arm import Array, Integers, Mask
from analysis.runs.laps import Laps
from analysis.runs.noise.readings import beyond_neighbours, is_outlier, noise_beneath, step_of
from analysis.runs.noise.spectrum import NODES, bursts, changes, following, node_response, without_slips

PHI = 2 * np.pi * np.arange(NODES) / NODES
"""Circle angles (NODES,) rad of a curve."""
_STIFF = 1e-3
"""Weight of second differences relative to the number of rows per node. They bridge nodes that have no rows."""
_SOLVED = 1e-9
"""Relative tolerance: a picometre in a millimetre."""
_COARSEST = 10.0
"""Smallest travel of a gauge in quantisation steps. A smaller travel gives a curve of two or three values."""
_BASE_ROWS = 20_000
_JUMPS = 2.0
"""Limit of an outlier in multiples of the line's change within two nodes."""


@dataclass(frozen=True)
class Reduced:
    """Laps of a run at NODES circle angles.

    g_mm (L, NODES, k): in order of time. order (NODES,): circle angle of each. samples: rows of all laps. rows: per
    lap, without outliers. readings: per lap, changed readings of the gauge with most repetitions. rate: rad/s of phi.
    step_mm, noise_mm (k,): quantisation of each gauge and the noise below it. blur: standard deviation, rad, of row
    positions from their times.
    """

    g_mm: Array
    order: Integers
    samples: int
    rows: float
    readings: float
    lap_s: float
    apart_s: float
    rate: float
    step_mm: tuple[float, ...]
    noise_mm: tuple[float, ...]
    blur: float
    notes: tuple[str, ...]


@dataclass(frozen=True)
class HatSums:
    """Sums over the rows between nodes per lap, (L, NODES).

    before, between, beyond: products of both hat functions. near, far (k, L, NODES): readings of each gauge times each
    hat function.
    """

    before: Array
    between: Array
    beyond: Array
    near: Array
    far: Array

    @property
    def rows(self) -> Array:
        """Sum (L, NODES) of all products of hat functions: the number of rows."""
        return self.before + 2 * self.between + self.beyond

    def without(self, odd: Mask) -> HatSums:
        return HatSums(*(np.where(odd, 0.0, values) for values in vars(self).values()))

    def lines(self) -> Array:
        """Closed least-squares polylines (L, NODES, k), in the unit of the readings, smoothed."""
        # Cyclic normal equations, slightly stiff to bridge nodes without rows, solved by conjugate gradients (Hestenes
        # and Stiefel 1952); about thirty rounds are sufficient if every node has rows.
        pull, diagonal = self.near + np.roll(self.far, 1, axis=2), self.before + np.roll(self.beyond, 1, axis=1)
        stiff = _STIFF * diagonal.mean(axis=1, keepdims=True)
        scale = 1 / (diagonal + 6 * stiff)

        def normal(x: Array) -> Array:
            bend = 2 * x - np.roll(x, 1, axis=-1) - np.roll(x, -1, axis=-1)
            bend = 2 * bend - np.roll(bend, 1, axis=-1) - np.roll(bend, -1, axis=-1)
            beside = self.between * np.roll(x, -1, axis=-1) + np.roll(self.between * x, 1, axis=-1)
            return np.asarray(diagonal * x + beside + stiff * bend)

        line: Array = scale * pull
        residual = pull - normal(line)
        way = scale * residual
        size = (residual * way).sum(axis=-1, keepdims=True)
        enough = _SOLVED**2 * np.maximum((pull * scale * pull).sum(axis=-1, keepdims=True), 1e-300)
        for _ in range(2 * NODES):
            if (size <= enough).all():
                break
            moved = normal(way)
            step = size / np.maximum((way * moved).sum(axis=-1, keepdims=True), 1e-300)
            line, residual = line + step * way, residual - step * moved
            before, size = size, (residual * scale * residual).sum(axis=-1, keepdims=True)
            way = scale * residual + size / np.maximum(before, 1e-300) * way
        smooth = np.fft.irfft(np.fft.rfft(line, axis=2) / node_response(), NODES, axis=2)
        return np.moveaxis(smooth, 0, 2)


def reduced(laps: Laps) -> Reduced:
    """Readings of a run at NODES circle angles per lap, with outliers removed and counted."""
    phi, g_mm = laps.phi, laps.g_mm
    lap = np.minimum(np.abs(phi - laps.start) // (2 * np.pi), laps.count - 1).astype(np.int64)
    # The level and the first two orders are removed before fitting polylines.
    some = slice(None, None, max(1, len(phi) // _BASE_ROWS))
    base = np.linalg.lstsq(_waves(phi[some]), g_mm[some], rcond=None)[0]
    rough = g_mm - _waves(phi) @ base
    wild = outliers_of(phi, rough, lap)
    hats = _hat_sums(phi, rough, lap, ~np.any(wild, axis=0))
    added = _waves(PHI) @ base
    nodes = hats.lines() + added
    odd: Mask = np.any([bursts(of_gauge) for of_gauge in np.moveaxis(nodes, 2, 0)], axis=0)
    if odd.any():
        nodes = hats.without(odd).lines() + added
        nodes = np.stack([following(of_gauge, odd) for of_gauge in np.moveaxis(nodes, 2, 0)], axis=2)
    sense = int(SENSE[laps.direction])
    first = int(np.ceil(sense * laps.start / (2 * np.pi) * NODES - 1e-6)) * sense
    order: Integers = (first + sense * np.arange(NODES)) % NODES  # order of the circle angles in a lap
    nodes, slips = _steady(nodes[:, order])
    steps = tuple(step_of(column) for column in g_mm.T)
    rate = sense * 2 * np.pi / laps.lap_s
    return Reduced(
        nodes,
        order,
        len(phi),
        round(float(hats.rows.sum())) / laps.count,
        min(int(np.count_nonzero(column[1:] != column[:-1])) for column in g_mm.T) / laps.count,
        laps.lap_s,
        laps.apart_s,
        rate,
        steps,
        tuple(noise_beneath(column, step) for column, step in zip(g_mm.T, steps, strict=True)),
        abs(rate) * laps.u_t_s,
        (*_remarks(g_mm, steps, wild, round(float(hats.rows[odd].sum()))), *slips),
    )


def _remarks(g_mm: Array, steps: Sequence[float], wild: Mask, burst: int) -> list[str]:
    """Notes on ignored readings, and on gauges with a resolution too coarse for their travel."""
    notes = []
    if wild.any():
        counts = ", ".join(map(str, np.count_nonzero(wild, axis=1)))
        notes.append(f"outliers are ignored: {counts} of {wild.shape[1]} (g1, g2)")
    for k, (moves, step) in enumerate(zip(np.ptp(g_mm, axis=0), steps, strict=True), start=1):
        if moves < _COARSEST * step:
            fact = f"g{k} reads in steps of {1e3 * step:.3g} µm and moves by {1e3 * moves:.3g} µm only, which is too"
            notes.append(f"{fact} coarse to show the curve: use a finer gauge or set the resolution")
    if burst:
        notes.append(f"{burst} readings near bursts of outliers are ignored: the other laps replace them")
    return notes


def outliers_of(phi: Array, rough: Array, lap: Integers) -> Mask:
    """Mask (k, n) of the outliers among readings rough (n, k) at phi (n,) rad of laps (n,), numbered from 0."""
    wild = np.array([is_outlier(column) for column in rough.T])
    if not wild.any():
        return wild
    # After a first outlier, further ones may be too dense for comparison with neighbours: they deviate from the
    # polyline through all readings by more than its local change, such as at a crossing of backlash.
    lines = _hat_sums(phi, rough, lap, ~np.any(wild, axis=0)).lines()
    node, share = place_of(phi)
    for k, of_gauge in enumerate(np.moveaxis(lines, 2, 0)):
        line = of_gauge[lap, node] * (1 - share) + of_gauge[lap, (node + 1) % NODES] * share
        away = np.abs(rough[:, k] - line)
        change = np.stack([changes(of_lap) for of_lap in of_gauge])
        wild[k] |= beyond_neighbours(away) & (away > _JUMPS * change[lap, node])
    return wild


def nodes_of(phi: Array, y: Array) -> Array:
    """A noise-free curve y (n,) over phi (n,) rad, of one lap, at PHI (NODES,)."""
    once, all_rows = np.zeros(len(phi), dtype=np.int64), np.ones(len(phi), dtype=bool)
    base = np.asarray(np.linalg.lstsq(_waves(phi), y[:, None], rcond=None)[0], dtype=np.float64)
    rough = y[:, None] - _waves(phi) @ base
    return np.asarray((_hat_sums(phi, rough, once, all_rows).lines()[0] + _waves(PHI) @ base)[:, 0])


def _waves(phi: Array) -> Array:
    return np.stack([np.ones_like(phi), np.sin(phi), np.cos(phi), np.sin(2 * phi), np.cos(2 * phi)], axis=1)


def _hat_sums(phi: Array, values: Array, lap: Integers, keep: Mask) -> HatSums:
    """Sums over the kept rows of each lap; values (n, k) at phi (n,) rad."""
    shape = (int(lap.max()) + 1, NODES)
    cell, share = place_of(phi[keep])
    at = lap[keep] * NODES + cell

    def summed(weights: Array) -> Array:
        return np.asarray(np.bincount(at, weights, shape[0] * NODES).reshape(shape), dtype=np.float64)

    near, far = (np.stack([summed(weight * column) for column in values[keep].T]) for weight in (1 - share, share))
    return HatSums(summed((1 - share) ** 2), summed(share * (1 - share)), summed(share**2), near, far)


def place_of(phi: Array) -> tuple[Integers, Array]:
    """Node (n,) behind each circle angle (n,) rad, and the relative position (n,) to the next."""
    place = phi % (2 * np.pi) * (NODES / (2 * np.pi))
    node = np.floor(place)
    return node.astype(np.int64) % NODES, place - node


def _steady(nodes: Array) -> tuple[Array, tuple[str, ...]]:
    """Laps (L, NODES, k) mm of the gauges without slips, and notes."""
    steady, notes = [], []
    for name, laps in zip(("g1", "g2"), np.moveaxis(nodes, 2, 0), strict=False):
        whole, slips = without_slips(laps)
        steady.append(whole)
        if slips:
            sizes = ", ".join(f"{1e3 * slip:+z.1f}" for slip in slips)
            notes.append(f"{name} slipped between the laps by {sizes} µm, which was removed: check the clamp")
    return np.stack(steady, axis=2), tuple(notes)
