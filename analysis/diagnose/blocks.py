"""Residuals of repeated runs, in the form in which noise is white: what the search works on.

Neighbouring readings on a circle are correlated, so circles are taken apart into orders (cycles a lap) of the sum and
of the difference of the gauges; the run-to-run differences of repeats, pooled over all circles, say how noisy each is.
Readings at targets are taken as they are. Where nothing was repeated the noise is assumed, and the answer says so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from analysis.fitting.estimate import Fit
from analysis.fitting.observation import Observation, residuals_of
from analysis.kinematics.arm import Array
from analysis.model.predict import Model
from analysis.reading.lap import lap_of
from analysis.reading.tables import CircleTable, Integers, PoseTable

GRID = 512
"""Circle angles that a lap is interpolated to; the highest order is a little under half of it."""
ORDERS = GRID // 2
_BANDS = (0, 1, 2, 3, 5, 8, 12, 18, 30, 50, 90, 150, ORDERS)
"""Edges of the bands of orders in which the noise is pooled."""
_ASSUMED_UM = {"circle": 1.5, "target": 2.0, "pose": 40.0}
"""Noise of a reading where nothing was repeated."""


@dataclass(frozen=True)
class Sampling:
    """How a circle's rows (m,) become values at the grid: the row before each grid angle, and the share of the next."""

    before: Integers
    after: Integers
    share: Array

    def __call__(self, values: Array) -> Array:
        """(m, …) at the rows to (GRID, …) at the grid."""
        share = self.share.reshape(-1, *[1] * (values.ndim - 1))
        gridded: Array = values[self.before] * (1 - share) + values[self.after] * share
        return gridded


@dataclass(frozen=True)
class Block:
    """Repeated runs of one test and direction. one: the first of them, whose feedback stands for all; y (N,): their
    mean residual in standard deviations; count of runs; phi (m,) rad of its rows on a circle."""

    name: str
    one: Observation
    sampling: Sampling | None
    sd_mm: Array
    y: Array
    count: int
    phi: Array

    def whitened(self, values: Array) -> Array:
        """Readings (m, k) or (m, k, p) mm of the block's rows, in its standard deviations: (N,) or (N, p)."""
        flat = _orders(self.sampling(values)) if self.sampling else values.reshape(-1, *values.shape[2:])
        scaled: Array = flat / self.sd_mm.reshape(-1, *[1] * (flat.ndim - 1))
        return scaled


def _orders(gridded: Array) -> Array:
    """Readings (GRID, 2, …) of two gauges to orders (2 (2 ORDERS - 1), …) of sum and difference, unitary."""
    g1, g2 = gridded[:, 0], gridded[:, 1]
    parts = []
    for channel in ((g1 + g2) / np.sqrt(2), (g2 - g1) / np.sqrt(2)):
        spectrum = np.fft.rfft(channel, axis=0, norm="ortho")
        parts += [spectrum[:1].real, np.sqrt(2) * spectrum[1:ORDERS].real, np.sqrt(2) * spectrum[1:ORDERS].imag]
    return np.concatenate(parts)


ORDER_OF = np.tile(np.concatenate([[0], np.arange(1, ORDERS), np.arange(1, ORDERS)]), 2)
"""The order of each entry of a circle's whitened vector; the first half is the sum of the gauges."""


def blocks_of(model: Model, observations: Sequence[Observation], fitted: Fit) -> tuple[list[Block], bool]:
    """Blocks of all observations, and whether their noise is from repeats. Raises FileError for a lap that is none."""
    groups: dict[str, list[int]] = {}
    for k, one in enumerate(observations):
        groups.setdefault(_name(one), []).append(k)
    residuals = residuals_of(fitted.model, observations, fitted.setups)
    flats: dict[str, list[Array]] = {}
    samplings: dict[str, tuple[Sampling | None, Array]] = {}
    for name, members in groups.items():
        for k in members:
            sampling, phi = _sampling(model, observations[k])
            flat = _orders(sampling(residuals[k])) if sampling else residuals[k].ravel()
            flats.setdefault(name, []).append(flat)
            samplings.setdefault(name, (sampling, phi))
    flats = {name: _alike(rows) for name, rows in flats.items()}
    repeated = any(len(rows) > 1 for rows in flats.values())
    circle_sd = _circle_sd([rows for name, rows in flats.items() if samplings[name][0] is not None])
    blocks = []
    for name, rows in flats.items():
        sampling, phi = samplings[name]
        sd = circle_sd if sampling else _target_sd(rows, observations[groups[name][0]])
        sd = sd / np.sqrt(len(rows))
        y = np.mean(rows, axis=0) / sd
        blocks.append(Block(name, observations[groups[name][0]], sampling, sd, y, len(rows), phi))
    return blocks, repeated


def _name(one: Observation) -> str:
    return f"{one.setup} {one.table.direction}" if isinstance(one.table, CircleTable) else one.setup


def _alike(rows: list[Array]) -> list[Array]:
    """Only repeats of the same length can be averaged; another length is another program."""
    return [row for row in rows if len(row) == len(rows[0])]


def _sampling(model: Model, one: Observation) -> tuple[Sampling | None, Array]:
    if not isinstance(one.table, CircleTable):
        return None, np.empty(0)
    lap = lap_of(one.table, model.rig, one.setup)
    order = np.argsort(lap.phi % (2 * np.pi))
    phi = (lap.phi % (2 * np.pi))[order]
    grid = np.arange(GRID) * 2 * np.pi / GRID
    after = np.searchsorted(phi, grid) % len(phi)
    before = after - 1
    step = (phi[after] - phi[before]) % (2 * np.pi)
    share = ((grid - phi[before]) % (2 * np.pi)) / np.where(step > 0, step, 1.0)
    return Sampling(order[before], order[after], np.clip(share, 0, 1)), lap.phi


def _circle_sd(groups: Sequence[list[Array]]) -> Array:
    """Standard deviation (N,) mm of each entry of one run, by channel and band of orders."""
    sd = np.full(len(ORDER_OF), _ASSUMED_UM["circle"] / 1000)
    freedom = sum(len(rows) - 1 for rows in groups)
    if not freedom:
        return sd
    squares = sum(((np.array(rows) - np.mean(rows, axis=0)) ** 2).sum(axis=0) for rows in groups)
    half = len(ORDER_OF) // 2
    for channel in (slice(0, half), slice(half, None)):
        order, power = ORDER_OF[channel], np.asarray(squares)[channel]
        for low, high in pairwise(_BANDS):
            band = (order >= low) & (order < high)
            pooled = power[band].sum() / (band.sum() * freedom)
            # Few repeats leave a band's noise uncertain; a little more than its mean keeps the tails honest.
            sd[channel][band] = np.sqrt(pooled * (1 + 2 / (band.sum() * freedom)))
    return np.asarray(np.maximum(sd, 1e-5), dtype=float)


def _target_sd(rows: list[Array], one: Observation) -> Array:
    kind = "pose" if isinstance(one.table, PoseTable) else "target"
    assumed = _ASSUMED_UM[kind] / 1000
    if len(rows) < 2:
        return np.full(len(rows[0]), assumed)
    freedom = (len(rows) - 1) * len(rows[0])
    pooled = ((np.array(rows) - np.mean(rows, axis=0)) ** 2).sum() / freedom
    return np.full(len(rows[0]), max(float(np.sqrt(pooled)), 1e-4))
