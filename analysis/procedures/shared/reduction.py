"""A run's readings reduced to 720 circle angles, lap by lap, without what is wild and without slips of a clamp.

    rows of a run  →  wild readings and bursts left out  →  least-squares broken line of each lap  →  slips taken out

Cost grows with the rows once, here; all that follows is of 720 numbers a lap.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.robot.geometry.circle import SENSE
from analysis.robot.kinematics.arm import Array
from analysis.runs.laps import Laps
from analysis.runs.noise.lap_changes import bursts, changes, following, without_slips
from analysis.runs.noise.readings import Mask, beyond_neighbours, is_wild, noise_beneath, step_of
from analysis.runs.noise.spectrum import NODES, Integers, node_response

PHI = 2 * np.pi * np.arange(NODES) / NODES
"""The circle angles (NODES,) rad of a curve."""
_STIFF = 1e-3
"""Weight of second differences, a share of the rows at a node, which bridge nodes without rows."""
_SOLVED = 1e-9
"""Relative: a picometre in a millimetre."""
_COARSEST = 10.0
"""Steps that a gauge must move by: with fewer the curve lies between two or three values."""
_BASE_ROWS = 20_000
_JUMPS = 2.0
"""A wild reading is further off than so many times the change of the line within two nodes."""
_BLOCK = 1 << 17
"""Rows at a time, so that a long run needs no memory for all of them."""


@dataclass(frozen=True)
class Reduced:
    """A run's laps at NODES circle angles. g_mm (L, NODES, k) in order of time; order (NODES,): which circle angle each
    is; samples: rows of all laps; rows: in a lap, without wild ones; readings: in a lap, of the gauge that repeats
    itself most, that differ from the one before; rate: rad/s of phi; step_mm, noise_mm (k,): rounding of each gauge and
    the noise beneath it; blur: standard deviation, rad, of where rows fell by their own times."""

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
    """Sums over the rows of each lap beside each node, (L, NODES): before, between and beyond of the products of both
    hat functions; near, far (k, L, NODES): of the readings of each gauge by the one and the other."""

    before: Array
    between: Array
    beyond: Array
    near: Array
    far: Array

    @property
    def rows(self) -> Array:
        """The number of rows (L, NODES)."""
        return self.before + 2 * self.between + self.beyond

    def without(self, odd: Mask) -> HatSums:
        """The same sums without the rows behind the nodes of a mask (L, NODES)."""
        return HatSums(*(np.where(odd, 0.0, values) for values in vars(self).values()))

    def lines(self, rounds: int = 2 * NODES) -> Array:
        """The closed broken lines (L, NODES, k), in the unit of the readings, that fit these best lap by lap, as smooth
        curves; some thirty rounds find them where every node has rows."""
        # Cyclic normal equations, a little stiff, so that a node without rows is bridged, by conjugate gradients
        # (Hestenes and Stiefel 1952).
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
    """What all rows of a run's laps come to. hats: of the rows that are not wild, less the waves `base` (5, k); count:
    of all rows; wild, changed (k): rows of each gauge that are wild, and that differ from the one before; range_mm,
    step_mm, noise_mm (k): of each gauge."""

    hats: HatSums
    base: Array
    count: int
    wild: tuple[int, ...]
    changed: tuple[int, ...]
    range_mm: tuple[float, ...]
    step_mm: tuple[float, ...]
    noise_mm: tuple[float, ...]


def reduced(laps: Laps) -> Reduced:
    """The readings of a run at NODES circle angles, lap by lap; wild readings are left out and counted."""
    base = base_of(laps)
    lap = np.minimum(np.abs(laps.phi - laps.start) // (2 * np.pi), laps.count - 1).astype(np.int64)
    rough = np.empty(laps.g_mm.shape)
    for begin in range(0, len(rough), _BLOCK):
        rows = slice(begin, begin + _BLOCK)
        rough[rows] = laps.g_mm[rows] - _waves(laps.phi[rows]) @ base
    wild = wild_of(laps.phi, rough, lap)
    hats = _hat_sums(laps.phi, rough, lap, ~np.any(wild, axis=0))
    steps = tuple(step_of(g_mm) for g_mm in laps.g_mm.T)
    beneath = tuple(noise_beneath(g_mm, step) for g_mm, step in zip(laps.g_mm.T, steps, strict=True))
    changed = tuple(int(np.count_nonzero(g_mm[1:] != g_mm[:-1])) for g_mm in laps.g_mm.T)
    ranges = tuple(float(np.ptp(column)) for column in laps.g_mm.T)
    counts = tuple(int(count) for count in wild.sum(axis=1))
    return of_rows(laps, LapRows(hats, base, len(laps.phi), counts, changed, ranges, steps, beneath))


def base_of(laps: Laps) -> Array:
    """Level and the first two orders (5, k) of the readings, which the broken lines need not follow."""
    rows = slice(None, None, max(1, len(laps.phi) // _BASE_ROWS))
    return np.asarray(np.linalg.lstsq(_waves(laps.phi[rows]), laps.g_mm[rows], rcond=None)[0], dtype=np.float64)


def slopes_of(base: Array) -> list[Array]:
    """The Taylor coefficients (NODES, k), up to the third order, of waves (5, k) behind each node, by the share of the
    way to the next."""
    step, slopes = 2 * np.pi / NODES, [_waves(PHI) @ base]
    derived = np.zeros((5, 5))
    derived[1, 2], derived[2, 1], derived[3, 4], derived[4, 3] = -1, 1, -2, 2
    for order in range(1, 4):
        base = derived @ base * (step / order)
        slopes.append(_waves(PHI) @ base)
    return slopes


def wild_of(phi: Array, rough: Array, lap: Integers, rounds: int = 2 * NODES) -> Mask:
    """Which of readings rough (n, k) at phi (n,) rad of laps counted from 0 are wild, (k, n). rounds: of finding lines;
    of a part of a lap few are enough, since between its nodes no others matter."""
    wild = np.array([is_wild(column) for column in rough.T])
    if not wild.any():
        return wild
    # Where there are some, others may have come too many in a row to leave their neighbours: these leave the broken
    # lines through all, and by more than a line changes there, as where a play is crossed.
    lines = _hat_sums(phi, rough, lap, ~np.any(wild, axis=0)).lines(rounds)
    node, share = place_of(phi)
    for k, of_gauge in enumerate(np.moveaxis(lines, 2, 0)):
        line = of_gauge[lap, node] * (1 - share) + of_gauge[lap, (node + 1) % NODES] * share
        away = np.abs(rough[:, k] - line)
        change = np.stack([changes(of_lap) for of_lap in of_gauge])
        wild[k] |= beyond_neighbours(away) & (away > _JUMPS * change[lap, node])
    return wild


def of_rows(laps: Laps, rows: LapRows) -> Reduced:
    """The readings at NODES circle angles of laps whose rows came to this."""
    added = _waves(PHI) @ rows.base
    hats, nodes = rows.hats, rows.hats.lines() + added
    odd: Mask = np.any([bursts(of_gauge) for of_gauge in np.moveaxis(nodes, 2, 0)], axis=0)
    if odd.any():
        nodes = hats.without(odd).lines() + added
        nodes = np.stack([following(of_gauge, odd) for of_gauge in np.moveaxis(nodes, 2, 0)], axis=2)
    sense = int(SENSE[laps.direction])
    first = int(np.ceil(sense * laps.start / (2 * np.pi) * NODES - 1e-6)) * sense
    order: Integers = (first + sense * np.arange(NODES)) % NODES  # in which a lap comes to the circle angles
    nodes, notes = _steady(nodes[:, order])
    if odd.any():
        burst = round(float(hats.rows[odd].sum()))
        notes = (f"{burst} readings beside bursts of wild readings are left out: the other laps replace them", *notes)
    coarse = (
        f"g{k} reads in steps of {1e3 * step:.3g} µm and moves by {1e3 * moves:.3g} µm only, which is too "
        "coarse to show the curve: use a finer gauge or set its resolution"
        for k, (moves, step) in enumerate(zip(rows.range_mm, rows.step_mm, strict=True), start=1)
        if moves < _COARSEST * step
    )
    notes = (*coarse, *notes)
    if any(rows.wild):
        wild = f"wild readings are left out: {', '.join(map(str, rows.wild))} of {rows.count} (g1, g2)"
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
    """Level and the first two orders (n, 5) at phi (n,)."""
    return np.stack([np.ones_like(phi), np.sin(phi), np.cos(phi), np.sin(2 * phi), np.cos(2 * phi)], axis=1)


def _hat_sums(phi: Array, values: Array, lap: Integers, keep: Mask) -> HatSums:
    """The sums of those of values (n, k) at phi (n,) rad that are kept, lap by lap; over blocks of rows."""
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
    """The node (n,) behind which each circle angle (n,) rad is, and its share (n,) of the way to the next."""
    place = phi % (2 * np.pi) * (NODES / (2 * np.pi))
    node = np.floor(place)
    return node.astype(np.int64) % NODES, place - node


def _steady(nodes: Array) -> tuple[Array, tuple[str, ...]]:
    """Laps (L, NODES, k) mm of the gauges without slips, and what was found, in words."""
    steady, notes = [], []
    for name, laps in zip(("g1", "g2"), np.moveaxis(nodes, 2, 0), strict=False):
        whole, slips = without_slips(laps)
        steady.append(whole)
        if slips:
            sizes = ", ".join(f"{1e3 * slip:+.1f}" for slip in slips)
            notes.append(f"{name} slipped between its laps by {sizes} µm, which was taken out: check its clamp")
    return np.stack(steady, axis=2), tuple(notes)
