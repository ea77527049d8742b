"""Residuals of repeated runs, in the form in which noise is white: what the search works on.

Neighbouring readings on a circle are correlated, so circles are taken apart into orders (cycles a lap) of the sum and
of the difference of the gauges; `noise` says how noisy each is. Readings at targets are taken as they are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.diagnose.noise import RunNoise, noise_of, reading_sd, shaken_by
from analysis.diagnose.observed import ORDER_OF, Sampling, Seen, thinned
from analysis.fitting.observation import Observation, residuals_of
from analysis.kinematics.arm import Array
from analysis.model.predict import Model, SetUp
from analysis.reading.tables import PoseTable

_BANDS = (0, 4, 8, 12, 18, 30, 50, 90, 150, len(ORDER_OF))
"""Edges of the bands of orders in which the noise is pooled."""
_SLOW = 4
"""Orders below this are as slow as a robot that stands."""


@dataclass(frozen=True)
class Block:
    """Repeated runs of one test and direction.

    model: of their rig file; one: the first of them, whose feedback stands for all; y (N,): their mean residual in
    standard deviations; sd_mm (N,) of it, scatter aside; count of runs; apart_mm: how far a run
    is from their mean, rms (nan for one run); span (N, c), size (c,): the directions in which the scatter of joints and
    ball moves a run, orthonormal, and how far.
    """

    name: str
    model: Model
    one: Observation
    sampling: Sampling | None
    sd_mm: Array
    y: Array
    count: int
    apart_mm: float
    span: Array
    size: Array

    def whitened(self, values: Array) -> Array:
        """Readings (m, k, …) mm in standard deviations: (N, …)."""
        return self.white(entries(values, self.sampling))

    def white(self, vector: Array) -> Array:
        """Entries (N, …) mm in standard deviations, of noise and scatter together: (1 + S S')^-1/2 of them."""
        tail = [1] * (vector.ndim - 1)
        scaled = vector / self.sd_mm.reshape(-1, *tail)
        less = 1 - 1 / np.sqrt(1 + self.size**2)
        white: Array = scaled - self.span @ (less.reshape(-1, *tail) * (self.span.T @ scaled))
        return white


def entries(values: Array, sampling: Sampling | None) -> Array:
    """Readings (m, k, …) mm as a block has them, (N, …) mm: a circle's by orders, others as they are."""
    return sampling.vector(values) if sampling else values.reshape(-1, *values.shape[2:])


def blocks_of(runs: Sequence[Seen], setups: Mapping[str, SetUp]) -> tuple[list[Block], RunNoise]:
    """Blocks of all runs about fitted set-ups, and the noise of one run on a circle."""
    groups: dict[str, list[Seen]] = {}
    for run in runs:
        groups.setdefault(run.name, []).append(run)
    gathered = [_gathered(name, members, setups) for name, members in groups.items()]
    circles = [(raw.rows[:, : len(ORDER_OF)], raw.shaken[: len(ORDER_OF)]) for raw in gathered if raw.first.sampling]
    grids = [raw.first.sampling.averaged for raw in gathered if raw.first.sampling]
    noise = noise_of(circles, ORDER_OF, _BANDS, float(np.mean(grids)) if grids else 1.0)
    rounding = np.max([run.rounding_deg for run in runs], axis=0)
    return [_block(raw, noise, rounding) for raw in gathered], noise


@dataclass(frozen=True)
class _Raw:
    """Residuals (n, N) mm of the runs of a block, and how scatter shows in them (N, c) mm."""

    name: str
    first: Seen
    rows: Array
    shaken: Array


def _gathered(name: str, members: Sequence[Seen], setups: Mapping[str, SetUp]) -> _Raw:
    # Where one run did not stand before and after, none is compared by it.
    if not all(run.sampling and run.sampling.stands for run in members):
        members = [replace(run, sampling=run.sampling and run.sampling.without_stands()) for run in members]
    vectors = [entries(residuals_of(run.model, [run.one], setups)[0], run.sampling) for run in members]
    first = members[0]
    shaken = shaken_by(first.model, first.one, setups[first.one.setup])
    # Only repeats of the same targets can be averaged.
    alike = [vector for vector in vectors if len(vector) == len(vectors[0])]
    return _Raw(name, first, np.array(alike), entries(shaken, first.sampling))


def _block(raw: _Raw, noise: RunNoise, rounding_deg: Array) -> Block:
    first, rows, count = thinned(raw.first), raw.rows, len(raw.rows)
    if first.sampling:
        sd = np.concatenate([noise.sd_mm, _standing_sd(noise, first.sampling)])
    else:
        sd = reading_sd(rows, raw.shaken, noise, rounding_deg, poses=isinstance(first.one.table, PoseTable))
    scatter = raw.shaken * noise.scatter(raw.shaken.shape[1]) / sd[:, None]
    span, size, _ = np.linalg.svd(scatter, full_matrices=False)
    mean = rows.mean(axis=0)
    apart = float(np.sqrt(((rows - mean) ** 2).sum() / ((count - 1) * rows.shape[1]))) if count > 1 else float("nan")
    sd = sd / np.sqrt(count)
    bare = Block(raw.name, first.model, first.one, first.sampling, sd, mean, count, apart, span, size)
    return replace(bare, y=bare.white(mean))


def _standing_sd(noise: RunNoise, sampling: Sampling) -> Array:
    """Of the means over stands, sum and difference of each: slow noise averages like white noise of its strength."""
    half = len(ORDER_OF) // 2
    slow = (ORDER_OF[:half] > 0) & (ORDER_OF[:half] < _SLOW)
    power = np.array([np.mean(noise.sd_mm[:half][slow] ** 2), np.mean(noise.sd_mm[half:][slow] ** 2)])
    return np.concatenate([np.sqrt(power / share) for share in sampling.stand_share] or [np.empty(0)])
