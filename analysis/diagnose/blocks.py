"""Residuals of repeated runs, in the form in which noise is white: what the search works on.

Neighbouring readings on a circle are correlated, so circles are taken apart into orders (cycles a lap) of the sum and
of the difference of the gauges; `noise` says how noisy each is. Readings at targets are taken as they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.diagnose.noise import noise_of, reading_sd, shaken_by
from analysis.diagnose.rounding import smooth
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
    mean residual in standard deviations; count of runs; phi (m,) rad of its rows on a circle; span (N, c), size
    (c,): the directions in which the scatter of joints and ball moves a run, orthonormal, and how far."""

    name: str
    one: Observation
    sampling: Sampling | None
    sd_mm: Array
    y: Array
    count: int
    phi: Array
    span: Array
    size: Array

    def whitened(self, values: Array) -> Array:
        """Readings (m, k) or (m, k, p) mm of the block's rows, in its standard deviations: (N,) or (N, p)."""
        return self.white(_orders(self.sampling(values)) if self.sampling else values.reshape(-1, *values.shape[2:]))

    def white(self, flat: Array) -> Array:
        """Entries (N, …) mm in standard deviations, of noise and scatter together: (1 + S S')^-1/2 of them."""
        scaled = flat / self.sd_mm.reshape(-1, *[1] * (flat.ndim - 1))
        less = 1 - 1 / np.sqrt(1 + self.size**2)
        white: Array = scaled - self.span @ (less.reshape(-1, *[1] * (flat.ndim - 1)) * (self.span.T @ scaled))
        return white


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
    smoothed = [smooth(one) for one in observations]
    observations = [one.observation for one in smoothed]
    rounding = np.max([one.rounding_deg for one in smoothed], axis=0)
    groups: dict[str, list[int]] = {}
    for k, one in enumerate(observations):
        groups.setdefault(_name(one), []).append(k)
    residuals = residuals_of(fitted.model, observations, fitted.setups)
    gathered = []
    for name, members in groups.items():
        first = observations[members[0]]
        samplings = [_sampling(model, observations[k]) for k in members]
        flats = [
            _orders(sampling(residuals[k])) if sampling else residuals[k].ravel()
            for k, (sampling, _) in zip(members, samplings, strict=True)
        ]
        shaken = shaken_by(model, first, fitted.setups[first.setup])
        sampling, phi = samplings[0]
        flat_shaken = _orders(sampling(shaken)) if sampling else shaken.reshape(-1, shaken.shape[2])
        gathered.append((name, first, sampling, phi, np.array(_alike(flats)), flat_shaken))
    noise = noise_of([(rows, shaken) for _, _, sampling, _, rows, shaken in gathered if sampling], ORDER_OF, _BANDS)
    blocks = []
    for name, first, sampling, phi, rows, shaken in gathered:
        if sampling:
            sd = noise.sd_mm
        else:
            sd = reading_sd(rows, shaken, noise, rounding, poses=isinstance(first.table, PoseTable))
        count = len(rows)
        span, size, _ = np.linalg.svd(shaken * noise.scatter(shaken.shape[1]) / sd[:, None], full_matrices=False)
        block = Block(name, first, sampling, sd / np.sqrt(count), np.empty(0), count, phi, span, size)
        blocks.append(replace(block, y=block.white(rows.mean(axis=0))))
    return blocks, noise.measured


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
