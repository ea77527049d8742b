"""Reduce a run to readings at 720 circle angles per lap, without outliers and mounting slips.

rows of a run  →  outliers and bursts removed  →  least-squares polyline of each lap  →  slips removed

The cost here is linear in the rows; all later steps use 720 numbers per lap.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.robot.geometry.circle import SENSE
from analysis.robot.kinematics.arm import Array
from analysis.runs.laps import Laps
from analysis.runs.noise.lap_changes import bursts, changes, following, without_slips
from analysis.runs.noise.readings import Mask, beyond_neighbours, is_outlier, noise_beneath, step_of
from analysis.runs.noise.spectrum import NODES, Integers, node_response

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
_BLOCK = 1 << 17
"""Rows per block, to limit the memory of a long run."""


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
        """Sums without the rows behind the nodes of a mask (L, NODES)."""
        return HatSums(*(np.where(odd, 0.0, values) for values in vars(self).values()))

    def lines(self, rounds: int = 2 * NODES) -> Array:
        """Closed least-squares polylines (L, NODES, k), in the unit of the readings, smoothed.

        About thirty rounds are sufficient if every node has rows.
        """
        # Cyclic normal equations, slightly stiff to bridge nodes without rows, solved by conjugate gradients (Hestenes
        # and Stiefel
        # 1952).
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
        for _ in range(rounds):
            if (size <= enough).all():
                break
            moved = normal(way)
            step = size / np.maximum((way * moved).sum(axis=-1, keepdims=True), 1e-300)
            line, residual = line + step * way, residual - step * moved
            before, size = size, (residual * scale * residual).sum(axis=-1, keepdims=True)
            way = scale * residual + size / np.maximum(before, 1e-300) * way
        smooth = np.fft.irfft(np.fft.rfft(line, axis=2) / node_response(), NODES, axis=2)
        return np.moveaxis(smooth, 0, 2)


@dataclass(frozen=True)
class LapRows:
    """Combined rows of a run's laps.

    hats: of the rows without outliers, less the waves `base` (5, k). count: of all rows. wild, changed (k): outliers
    and changed readings per gauge. range_mm, step_mm, noise_mm (k): per gauge.
    """

    hats: HatSums
    base: Array
    count: int
    wild: tuple[int, ...]
    changed: tuple[int, ...]
    range_mm: tuple[float, ...]
    step_mm: tuple[float, ...]
    noise_mm: tuple[float, ...]


def reduced(laps: Laps) -> Reduced:
    """Readings of a run at NODES circle angles per lap, with outliers removed and counted."""
    base = base_of(laps)
    lap = np.minimum(np.abs(laps.phi - laps.start) // (2 * np.pi), laps.count - 1).astype(np.int64)
    rough = np.empty(laps.g_mm.shape)
    for begin in range(0, len(rough), _BLOCK):
        rows = slice(begin, begin + _BLOCK)
        rough[rows] = laps.g_mm[rows] - _waves(laps.phi[rows]) @ base
    wild = outliers_of(laps.phi, rough, lap)
    hats = _hat_sums(laps.phi, rough, lap, ~np.any(wild, axis=0))
    steps = tuple(step_of(g_mm) for g_mm in laps.g_mm.T)
    beneath = tuple(noise_beneath(g_mm, step) for g_mm, step in zip(laps.g_mm.T, steps, strict=True))
    changed = tuple(int(np.count_nonzero(g_mm[1:] != g_mm[:-1])) for g_mm in laps.g_mm.T)
    ranges = tuple(float(np.ptp(column)) for column in laps.g_mm.T)
    counts = tuple(int(count) for count in wild.sum(axis=1))
    return of_rows(laps, LapRows(hats, base, len(laps.phi), counts, changed, ranges, steps, beneath))


def base_of(laps: Laps) -> Array:
    """Level and first two orders (5, k) of the readings, removed before fitting polylines."""
    rows = slice(None, None, max(1, len(laps.phi) // _BASE_ROWS))
    return np.asarray(np.linalg.lstsq(_waves(laps.phi[rows]), laps.g_mm[rows], rcond=None)[0], dtype=np.float64)


def slopes_of(base: Array) -> list[Array]:
    """Taylor coefficients (NODES, k), up to the third order, of waves (5, k) behind each node, by
    relative position."""
    step, slopes = 2 * np.pi / NODES, [_waves(PHI) @ base]
    derived = np.zeros((5, 5))
    derived[1, 2], derived[2, 1], derived[3, 4], derived[4, 3] = -1, 1, -2, 2
    for order in range(1, 4):
        base = derived @ base * (step / order)
        slopes.append(_waves(PHI) @ base)
    return slopes


def outliers_of(phi: Array, rough: Array, lap: Integers, rounds: int = 2 * NODES) -> Mask:
    """Mask (k, n) of the outliers among readings rough (n, k) at phi (n,) rad.

    lap (n,): number of the lap, from 0. rounds: rounds of the solver. A part of a lap needs only a few, because distant
    nodes have no influence.
    """
    wild = np.array([is_outlier(column) for column in rough.T])
    if not wild.any():
        return wild
    # After a first outlier, further ones may be too dense for comparison with neighbours: they deviate from the
    # polyline through
    # all readings by more than its local change, such as at a crossing of backlash.
    lines = _hat_sums(phi, rough, lap, ~np.any(wild, axis=0)).lines(rounds)
    node, share = place_of(phi)
    for k, of_gauge in enumerate(np.moveaxis(lines, 2, 0)):
        line = of_gauge[lap, node] * (1 - share) + of_gauge[lap, (node + 1) % NODES] * share
        away = np.abs(rough[:, k] - line)
        change = np.stack([changes(of_lap) for of_lap in of_gauge])
        wild[k] |= beyond_neighbours(away) & (away > _JUMPS * change[lap, node])
    return wild


def of_rows(laps: Laps, rows: LapRows) -> Reduced:
    """Readings at NODES circle angles, as curves through the combined rows of the laps."""
    added = _waves(PHI) @ rows.base
    hats, nodes = rows.hats, rows.hats.lines() + added
    odd: Mask = np.any([bursts(of_gauge) for of_gauge in np.moveaxis(nodes, 2, 0)], axis=0)
    if odd.any():
        nodes = hats.without(odd).lines() + added
        nodes = np.stack([following(of_gauge, odd) for of_gauge in np.moveaxis(nodes, 2, 0)], axis=2)
    sense = int(SENSE[laps.direction])
    first = int(np.ceil(sense * laps.start / (2 * np.pi) * NODES - 1e-6)) * sense
    order: Integers = (first + sense * np.arange(NODES)) % NODES  # order of the circle angles in a lap
    nodes, notes = _steady(nodes[:, order])
    if odd.any():
        burst = round(float(hats.rows[odd].sum()))
        notes = (f"{burst} readings near bursts of outliers are ignored: the other laps replace them", *notes)
    coarse = (
        f"g{k} reads in steps of {1e3 * step:.3g} µm and moves by {1e3 * moves:.3g} µm only, which is too "
        "coarse to show the curve: use a finer gauge or set the resolution"
        for k, (moves, step) in enumerate(zip(rows.range_mm, rows.step_mm, strict=True), start=1)
        if moves < _COARSEST * step
    )
    notes = (*coarse, *notes)
    if any(rows.wild):
        wild = f"outliers are ignored: {', '.join(map(str, rows.wild))} of {rows.count} (g1, g2)"
        notes = (wild, *notes)
    return Reduced(
        nodes,
        order,
        rows.count,
        round(float(hats.rows.sum())) / laps.count,
        min(rows.changed) / laps.count,
        laps.lap_s,
        laps.apart_s,
        rate := sense * 2 * np.pi / laps.lap_s,
        rows.step_mm,
        rows.noise_mm,
        abs(rate) * laps.u_t_s,
        notes,
    )


def nodes_of(phi: Array, y: Array) -> Array:
    """A noise-free curve y (n,) over phi (n,) rad, of one lap, at PHI (NODES,)."""
    once, all_rows = np.zeros(len(phi), dtype=np.int64), np.ones(len(phi), dtype=bool)
    base = np.asarray(np.linalg.lstsq(_waves(phi), y[:, None], rcond=None)[0], dtype=np.float64)
    rough = y[:, None] - _waves(phi) @ base
    return np.asarray((_hat_sums(phi, rough, once, all_rows).lines()[0] + _waves(PHI) @ base)[:, 0])


def _waves(phi: Array) -> Array:
    """Level and first two orders (n, 5) at phi (n,) rad."""
    return np.stack([np.ones_like(phi), np.sin(phi), np.cos(phi), np.sin(2 * phi), np.cos(2 * phi)], axis=1)


def _hat_sums(phi: Array, values: Array, lap: Integers, keep: Mask) -> HatSums:
    """Sums over the kept rows of each lap, computed in blocks of rows. values (n, k) at phi (n,) rad."""
    count = int(lap.max()) + 1
    beyond, between, before = (np.zeros(count * NODES) for _ in range(3))
    pull_left, pull_right = (np.zeros((values.shape[1], count * NODES)) for _ in range(2))
    for begin in range(0, len(phi), _BLOCK):
        rows = begin + np.flatnonzero(keep[begin : begin + _BLOCK])
        cell, share = place_of(phi[rows])
        at = lap[rows] * NODES + cell
        before += np.bincount(at, (1 - share) ** 2, len(before))
        between += np.bincount(at, share * (1 - share), len(before))
        beyond += np.bincount(at, share**2, len(before))
        for k, column in enumerate(values[rows].T):
            pull_left[k] += np.bincount(at, (1 - share) * column, len(before))
            pull_right[k] += np.bincount(at, share * column, len(before))
    shape = (count, NODES)
    pulls = (pull_left.reshape(-1, *shape), pull_right.reshape(-1, *shape))
    return HatSums(before.reshape(shape), between.reshape(shape), beyond.reshape(shape), *pulls)


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
