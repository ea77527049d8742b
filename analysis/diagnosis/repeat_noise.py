"""The noise of the readings, estimated from repeats: of each order of a circle, of each run and of each target.

Repeated runs separate it from the scatter of joints and ball between runs (`run_scatter`). The noise of a set-up has
one shape over the orders, and a level for each run, for slow and for fine orders, and for sum and difference of the
gauges. Without repeats, the noise of real cells is assumed (`analysis.noise.cell`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.observed_run import ORDER_OF
from analysis.diagnosis.run_scatter import (
    ASSUMED_SCATTER,
    RunScatter,
    ScatteredRuns,
    average_scatter,
    scatter_of,
    unscattered,
)
from analysis.kinematics.arm import Array, Integers
from analysis.noise.cell import SLOW_MM, TARGET_MM, WHITE_MM

_BANDS = (0, 4, 8, 12, 18, 30, 50, 90, 150, len(ORDER_OF))
"""Edges of the bands of orders in which the noise is pooled. Chosen: wide enough for several degrees of freedom per
band with two repeats."""
_SLOW = 30
"""Orders below this share a level, and so do those above: servo ripple and path errors are slow, the noise of a probe
is not. Chosen."""
_SLOW_HALF = 5.0
"""The order at which assumed slow noise has half its power: a correlation time of 1.5 s in a lap of 45 s, within the
0.1 to 5 s of real cells."""
_ROUNDS = 4
"""Number of rounds in which noise and scatter are estimated in turn. Chosen: a further one changes the noise by less
than its uncertainty."""
_BORROWED = 4.0
"""Degrees of freedom with which a band counts the noise of its finer neighbour. Chosen: as for targets, fewer than a
band has that no scatter hides."""
_LEAST_MM = 1e-5
"""Smallest standard deviation of an entry, far below any gauge, so that exact repeats do not give infinite weights."""
_LEAST_FREE = 0.1
"""Smallest share of a reading that is left once the scatter of a run is removed. Chosen: it limits the correction to a
factor of about three."""
_LEAST_LEVEL = 1e-6
"""Smallest level of a run, so that a run that repeats another to the last digit does not get infinite weight."""
_AGREEMENT = 4.0
"""Degrees of freedom that all targets together contribute to the variance of one (Smyth 2004). Chosen: makes the
tenfold differences between the targets of real cells likely."""
LEAST_ASSUMED = (TARGET_MM.low / TARGET_MM.rms) ** 2
"""Smallest power of assumed noise, relative to its mean: the lower bound of real cells."""
POSE_MM = 0.04
"""Scatter of a coordinate of a pose if no pose was visited twice: UR10, two visits (Landgraf et al. 2021)."""


@dataclass(frozen=True)
class Repeated:
    """Repeated runs of one test and direction: `rows` (n, N) mm of n runs, the responses `response` (N, c) mm and
    `drifting` (w, N, c) mm to a unit scatter, the number of laps of which a row is the mean, and what one standard
    deviation of the scatter of stamps adds to it, `stamps` (N, s) mm."""

    setup: str
    rows: Array
    response: Array
    drifting: Array
    laps: int
    stamps: Array


@dataclass(frozen=True)
class CircleNoise:
    """Noise of circles. `sd_mm` has an array (n, N) for each block; `scattered` has the scatter of each set-up;
    `measured` states whether they come from repeats."""

    sd_mm: tuple[Array, ...]
    scattered: dict[str, RunScatter]
    measured: bool

    def scatter(self, setup: str) -> RunScatter:
        """Return the scatter of a set-up; one without repeated circles gets the average of all."""
        return self.scattered.get(setup) or average_scatter(list(self.scattered.values()))


def circle_noise(groups: Sequence[Repeated], averaged: float) -> CircleNoise:
    """Return the noise of circles from the repeats `rows` (n, N) mm of each group. `averaged` is the share of the power
    of white noise that remains on the grid of a circle."""
    repeated: dict[str, list[int]] = {}
    for k, group in enumerate(groups):
        if len(group.rows) > 1:
            repeated.setdefault(group.setup, []).append(k)
    if not repeated:
        assumed = [np.tile(_assumed(group, averaged), (len(group.rows), 1)) for group in groups]
        return CircleNoise(tuple(assumed), {"": ASSUMED_SCATTER}, measured=False)
    sd_mm: dict[int, Array] = {}
    scattered = {}
    for setup, own in repeated.items():
        found, scattered[setup] = _setup_noise([_scattered(groups[k]) for k in own])
        sd_mm.update(zip(own, found, strict=True))
    # A run that was not repeated borrows the noise of its set-up, or else of all.
    every = list(sd_mm)
    for k, group in enumerate(groups):
        lenders = repeated.get(group.setup, every)
        borrowed = np.sqrt(np.mean(np.concatenate([sd_mm[one] for one in lenders]) ** 2, axis=0))
        sd_mm.setdefault(k, np.tile(borrowed, (len(group.rows), 1)))
    return CircleNoise(tuple(sd_mm[k] for k in range(len(groups))), scattered, measured=True)


def _scattered(group: Repeated) -> ScatteredRuns:
    apart = group.rows - group.rows.mean(axis=0)
    return ScatteredRuns(apart, group.response, group.drifting, group.stamps)


def _setup_noise(every: Sequence[ScatteredRuns]) -> tuple[list[Array], RunScatter]:
    """Return the noise (n, N) mm of the runs of each repeated group of a set-up, and their scatter.

    Noise and scatter are estimated in turn, each with what the other explains removed; in the first round the noise is
    taken from what no scatter could explain.
    """
    parts = [unscattered(runs.apart, np.concatenate([runs.constant, *runs.drifting], axis=1)) for runs in every]
    levels = [np.ones((len(runs.apart), 4)) for runs in every]
    for _ in range(_ROUNDS):
        for _ in range(2):
            shape = _shape(
                [own / level[:, _PART] for (own, _), level in zip(parts, levels, strict=True)],
                [free for _, free in parts],
            )
            levels = [_levels(own / shape, free) for own, free in parts]
        sd_mm = [np.maximum(shape * level[:, _PART], _LEAST_MM) for level in levels]
        typical = [np.sqrt((sd**2).mean(axis=0)) for sd in sd_mm]
        scatter = scatter_of(list(zip(every, typical, strict=True)))
        parts = [runs.noise(scatter, sd) for runs, sd in zip(every, typical, strict=True)]
    return sd_mm, scatter


_PART: Integers = np.asarray((np.arange(len(ORDER_OF)) >= len(ORDER_OF) // 2) * 2 + (ORDER_OF >= _SLOW), dtype=np.int64)
"""The index of an entry's level among the four levels of a run."""


def _assumed(group: Repeated, averaged: float) -> Array:
    """Return the assumed standard deviation (N,) mm of the entries of one run, from the noise of real cells. A drifting
    scatter, which nothing separates from the noise of a single run, is in it by bands."""
    count = len(ORDER_OF) // 2
    slow = 1 / (1 + (ORDER_OF / _SLOW_HALF) ** 2)
    # The energy of a channel of `count` unitary entries is `count` times the mean square of its readings.
    slow *= SLOW_MM.rms**2 / group.laps * count / slow[:count].sum()
    drifting = ((group.drifting * ASSUMED_SCATTER.drifting(group.response.shape[1])) ** 2).sum(axis=(0, 2))
    for entries in _bands():
        drifting[entries] = drifting[entries].mean()
    sd: Array = np.sqrt(WHITE_MM.rms**2 * averaged + slow + drifting)
    return sd


def _bands() -> list[Integers]:
    """Return the indices of the entries of each channel and band in which noise is pooled."""
    half = len(ORDER_OF) // 2
    channels = (np.arange(half), np.arange(half, len(ORDER_OF)))
    bands = [(channel, low, high) for channel in channels for low, high in pairwise(_BANDS)]
    return [channel[(ORDER_OF[channel] >= low) & (ORDER_OF[channel] < high)] for channel, low, high in bands]


def _shape(own: Sequence[Array], free: Sequence[Array]) -> Array:
    """Return the standard deviation (N,) of runs at level one, by channel and band, of the part that scatter cannot
    explain.

    Scatter may hide nearly all of the slowest orders, and few repeats leave every band uncertain. So each band counts
    its finer neighbour as some more readings: slow noise grows towards slow orders.
    """
    squares = np.asarray(sum((rows**2).sum(axis=0) for rows in own))
    freedom = np.asarray(sum((len(rows) - 1) * share for rows, share in zip(own, free, strict=True)))
    shape, finer = np.empty(len(ORDER_OF)), 0.0
    for band in reversed(_bands()):
        known = _BORROWED if ORDER_OF[band].max() < ORDER_OF.max() else 0.0
        seen = freedom[band].sum() + known
        # Its scaled inverse chi-square has a mean of about 1 + 2/ν.
        variance = (squares[band].sum() + known * finer) / seen * (1 + 2 / seen)
        shape[band], finer = np.sqrt(variance), variance
    return np.maximum(shape, _LEAST_MM)


def _levels(own: Array, free: Array) -> Array:
    """Return the levels (n, 4) of repeated runs, from their deviations (n, N) from their mean divided by the shape of
    the noise.

    With variances σ_r² of n runs, the expected mean square q_r of a run's deviation from their mean is σ_r² (1 - 2/n) +
    Σ σ²/n².
    """
    n = len(own)
    q = np.stack([(own[:, part == _PART] ** 2).sum(axis=1) / free[part == _PART].sum() for part in range(4)], axis=1)
    total = q.sum(axis=0) * n / (n - 1)
    if n < 3:
        return np.tile(np.maximum(np.sqrt(total / n), _LEAST_LEVEL), (n, 1))
    each = (q - total / n**2) / (1 - 2 / n)
    # The estimate for the quietest of few runs can be zero; no run gets less than a quarter of their mean level.
    level: Array = np.maximum(np.sqrt(np.maximum(each, total / n / 16)), _LEAST_LEVEL)
    return level


def target_sd(rows_mm: Array, response: Array, alike: NDArray[np.int64]) -> tuple[Array, bool]:
    """Return the standard deviation (N,) mm of readings at targets of repeated runs (n, N) mm, and whether repeats
    determine it. The scatter that moves all targets of a run together, with a response (N, c), is excluded. `alike`
    (N,) has an integer that readings of the same place and approach share."""
    mean = rows_mm.mean(axis=0)
    own, free = unscattered(rows_mm - mean, response)
    # The part that the scatter of a run explains is removed, and the rest is scaled to its original variance.
    rows = mean + own / np.sqrt(np.maximum(free, _LEAST_FREE))
    squares, freedom = np.zeros(rows.shape[1]), np.zeros(rows.shape[1])
    away = []
    for number in np.unique(alike):
        here = np.flatnonzero(alike == number)
        group = rows[:, here]
        if group.size > 1:
            off = (group - group.mean()) * np.sqrt(group.size / (group.size - 1))
            away.append(off.ravel())
            squares[here] = (off**2).sum() * (group.size - 1) / group.size
            freedom[here] = group.size - 1
    if not away:
        return np.full(rows.shape[1], TARGET_MM.rms), False
    # A median is robust against heavy tails and outliers; the target's own scatter then enters with its weight.
    common = max(1.4826 * float(np.median(np.abs(np.concatenate(away)))), 10 * _LEAST_MM)
    sd: Array = np.sqrt((_AGREEMENT * common**2 + squares) / (_AGREEMENT + freedom))
    return sd, True
