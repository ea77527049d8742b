"""How noisy the readings are: of each order of a circle, of each run, of each target, and of how a run lies.

From run to run every joint and the ball lie a little elsewhere. That scatter moves all readings of a run together, in a
way that the arm's geometry gives; repeated runs show it apart from the noise of the readings. The noise has one shape
over the orders, pooled over all circles, and a level of its own in each run, for slow and for fine orders, and for sum
and difference of the gauges. What was not repeated is assumed as wide as real cells have it (`analysis.noise.cell`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.observed import GRID, ORDER_OF, by_orders, curve
from analysis.fitting.observation import Observation, predicted, seen
from analysis.kinematics.arm import Array, Integers
from analysis.model.predict import Model, SetUp, moved
from analysis.noise.cell import BALL_MM, JOINT_DEG, SLOW_MM, TARGET_MM, WHITE_MM
from analysis.traces.tables import PoseTable
from rigs.effects import turned

SCATTER_DEG, SCATTER_MM = 0.0002, 0.001
"""The scatter of joints and ball that `shaken_by` shows; all others are multiples of it."""
_MULTIPLES = np.array([0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 5.0, 8.0, 13.0, 21.0, 34.0])
"""Scatter that is looked for: up to the largest of real cells."""
_BANDS = (0, 4, 8, 12, 18, 30, 50, 90, 150, len(ORDER_OF))
"""Edges of the bands of orders in which the noise is pooled."""
_SLOW = 30
"""Orders below this share a level, and those above: servo ripple and path errors are slow, a probe's noise is not."""
_SLOW_HALF = 5.0
"""The order at which assumed slow noise has half its power: a correlation of 1.5 s along a lap of 45 s."""
WANDERING = 0.5
"""Share of the energy of a run's scatter that changes along the run, where nothing is measured: encoders and warming up
move joints and ball smoothly. Repeats show that as slow noise, and few of them take all of it for constant as well."""
_WANDERS = 3
"""Orders that this change has, in cycles a run."""
_LEAST_MM = 1e-5
_LEAST_FREE = 0.1
"""Of a reading that the scatter of a run could do nearly all of."""
_LEAST_LEVEL = 1e-6
"""Of a run that repeats another to the last digit."""
_AGREEMENT = 4.0
"""Degrees of freedom that all targets together lend to the variance of one: as many as real cells' scatter, different
by a factor of ten between targets, makes likely (Smyth 2004)."""
LEAST_ASSUMED = (TARGET_MM.low / TARGET_MM.rms) ** 2
"""Of the power of noise that is assumed as wide as real cells have it: the least that they have."""
POSE_MM = 0.04
"""Scatter of a coordinate of a pose where nothing was visited twice: UR10, two visits (Landgraf et al. 2021)."""


@dataclass(frozen=True)
class Repeated:
    """Repeated runs of one test and direction: set-up, rows (n, N) mm, what unit scatter does to them, (N, c) mm; laps
    of each, of which a row is the mean."""

    setup: str
    rows: Array
    shaken: Array
    laps: int = 1


@dataclass(frozen=True)
class CircleNoise:
    """Noise of circles. sd_mm: for each block (n, N) of each run; scattered: multiples of joints and of ball by set-up,
    each has its own; measured: whether it is from repeats."""

    sd_mm: tuple[Array, ...]
    scattered: dict[str, tuple[float, float]]
    measured: bool

    def scatter(self, setup: str, terms: int) -> Array:
        """(terms,): six joints, then the ball where it is one of them. Of a set-up without circles as of all."""
        every = np.sqrt(np.mean(np.array(list(self.scattered.values())) ** 2, axis=0))
        joints, ball = self.scattered.get(setup, (float(every[0]), float(every[1])))
        return np.array([joints] * 6 + [ball] * 3)[:terms]


def shaken_by(model: Model, one: Observation, setup: SetUp) -> Array:
    """What a unit scatter of each joint and of the ball adds to the readings, (m, k, 9) mm; for poses, whose
    instrument's place is fitted anyway, of the joints alone (m, 3, 6)."""
    scene = moved(model, one.path)
    base = seen(model, one, scene, setup)
    columns = []
    for axis in range(1, 7):
        off = replace(model, effects=(*model.effects, turned(axis, SCATTER_DEG)))
        columns.append(predicted(off, one, setup) - base)
    if not isinstance(one.table, PoseTable):
        steps = SCATTER_MM * np.eye(3)
        columns += [seen(model, one, scene, replace(setup, ball=setup.ball + step)) - base for step in steps]
    return np.stack(columns, axis=2)


def circle_noise(groups: Sequence[Repeated], averaged: float) -> CircleNoise:
    """Noise of circles from their repeats; averaged: what a circle's grid leaves of the power of white noise."""
    spans = [_span(group.shaken) for group in groups]
    apart = [group.rows - group.rows.mean(axis=0) for group in groups]
    own = [rows - (rows @ span) @ span.T for rows, span in zip(apart, spans, strict=True)]
    free = [1 - (span**2).sum(axis=1) for span in spans]
    repeated = [k for k, rows in enumerate(own) if len(rows) > 1]
    if not repeated:
        scattered = {"": (JOINT_DEG.rms / SCATTER_DEG, BALL_MM.rms / SCATTER_MM)}
        assumed = CircleNoise((), scattered, measured=False)
        noisy = [
            np.hypot(
                _assumed(averaged, group.laps),
                _wandering(group.shaken * assumed.scatter(group.setup, group.shaken.shape[1]), group.laps),
            )
            for group in groups
        ]
        return replace(assumed, sd_mm=tuple(np.tile(one, (len(rows), 1)) for one, rows in zip(noisy, own, strict=True)))
    levels = {k: np.ones((len(own[k]), 4)) for k in repeated}
    shape = np.ones(len(ORDER_OF))
    for _ in range(3):
        shape = _shape([own[k] / levels[k][:, _PART] for k in repeated], [free[k] for k in repeated])
        levels = {k: _levels(own[k] / shape, free[k]) for k in repeated}
    typical = np.sqrt(np.mean([np.mean(level**2, axis=0) for level in levels.values()], axis=0))
    sd_mm = tuple(
        np.maximum(shape * levels.get(k, np.tile(typical, (len(rows), 1)))[:, _PART], _LEAST_MM)
        for k, rows in enumerate(own)
    )
    own_of: dict[str, list[int]] = {}
    for k in repeated:
        own_of.setdefault(groups[k].setup, []).append(k)
    scattered = {
        setup: _scatter([(apart[k], groups[k].shaken, sd_mm[k]) for k in own]) for setup, own in own_of.items()
    }
    return CircleNoise(sd_mm, scattered, measured=True)


_PART: Integers = np.asarray((np.arange(len(ORDER_OF)) >= len(ORDER_OF) // 2) * 2 + (ORDER_OF >= _SLOW), dtype=np.int64)
"""Which of the four levels of a run an entry has."""


def _assumed(averaged: float, laps: int) -> Array:
    """Standard deviation (N,) mm of the entries of one run of some laps, as wide as real cells have it."""
    count = len(ORDER_OF) // 2
    slow = 1 / (1 + (ORDER_OF / _SLOW_HALF) ** 2)
    # A channel of `count` unitary entries holds `count` times the mean square of its readings.
    slow *= SLOW_MM.rms**2 / laps * count / slow[:count].sum()
    sd: Array = np.sqrt(WHITE_MM.rms**2 * averaged + slow)
    return sd


def _wandering(scatter_mm: Array, laps: int) -> Array:
    """Standard deviation (N,) mm, by bands, of what scatter adds to the mean of some laps where it changes along a run;
    scatter_mm (N, c): what all of it would add if it did not."""
    angle = 2 * np.pi * np.arange(GRID) / GRID
    # The mean of laps keeps only what comes back in each.
    orders = [order // laps for order in range(1, _WANDERS + 1) if order % laps == 0]
    variance = np.zeros(len(scatter_mm))
    still = np.stack([curve(column) for column in scatter_mm.T], axis=2)
    for wave in (turn(order * angle) for order in orders for turn in (np.cos, np.sin)):
        variance += WANDERING / _WANDERS * (by_orders(wave[:, None, None] * still) ** 2).sum(axis=1)
    for entries in _bands():
        variance[entries] = variance[entries].mean()
    sd: Array = np.sqrt(variance)
    return sd


def _bands() -> list[Integers]:
    """The entries of each channel and band in which noise is pooled."""
    half = len(ORDER_OF) // 2
    channels = (np.arange(half), np.arange(half, len(ORDER_OF)))
    bands = [(channel, low, high) for channel in channels for low, high in pairwise(_BANDS)]
    return [channel[(ORDER_OF[channel] >= low) & (ORDER_OF[channel] < high)] for channel, low, high in bands]


def _span(columns: Array) -> Array:
    """An orthonormal basis of columns, what is next to nothing left out."""
    left, size, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(left[:, size > 1e-3 * size[0]], dtype=float)


def _shape(own: Sequence[Array], free: Sequence[Array]) -> Array:
    """Standard deviation (N,) of runs at level one, by channel and band, of what scatter cannot have done."""
    squares = sum((rows**2).sum(axis=0) for rows in own)
    freedom = sum((len(rows) - 1) * share for rows, share in zip(own, free, strict=True))
    shape = np.empty(len(ORDER_OF))
    for band in _bands():
        free_here = max(np.asarray(freedom)[band].sum(), 1.0)
        # Few repeats leave a band's noise uncertain; a little more than its mean keeps the tails honest.
        shape[band] = np.sqrt(np.asarray(squares)[band].sum() / free_here * (1 + 2 / free_here))
    return np.maximum(shape, _LEAST_MM)


def _levels(own: Array, free: Array) -> Array:
    """Levels (n, 4) of repeated runs, from their deviations (n, N) from their mean over the noise's shape.

    With variances σ_r² of n runs, the mean square q_r of what one is off their mean is σ_r² (1 - 2/n) + Σ σ²/n².
    """
    n = len(own)
    q = np.stack([(own[:, part == _PART] ** 2).sum(axis=1) / free[part == _PART].sum() for part in range(4)], axis=1)
    total = q.sum(axis=0) * n / (n - 1)
    if n < 3:
        return np.tile(np.maximum(np.sqrt(total / n), _LEAST_LEVEL), (n, 1))
    each = (q - total / n**2) / (1 - 2 / n)
    # The quietest of few runs can come out at nothing; none is less than a quarter of their mean level.
    level: Array = np.maximum(np.sqrt(np.maximum(each, total / n / 16)), _LEAST_LEVEL)
    return level


def _scatter(repeated: Sequence[tuple[Array, Array, Array]]) -> tuple[float, float]:
    """The multiples of joints and of ball that make the differences of repeats most likely; repeated: deviations
    (n, N), what unit scatter does (N, 9), and the noise (n, N)."""
    looked = []
    for apart, shaken, each in repeated:
        sd = np.sqrt((each**2).mean(axis=0))
        columns = shaken / sd[:, None]
        span = _span(columns)
        inside = span.T @ columns
        joints, ball = inside[:, :6] @ inside[:, :6].T, inside[:, 6:] @ inside[:, 6:].T
        looked.append((len(apart) - 1, (apart / sd) @ span, joints, ball))

    def likelihood(joints: float, ball: float) -> float:
        total = 0.0
        for freedom, Z, of_joints, of_ball in looked:
            C = np.eye(len(of_joints)) + joints**2 * of_joints + ball**2 * of_ball
            total -= 0.5 * (freedom * np.linalg.slogdet(C)[1] + np.sum(Z * np.linalg.solve(C, Z.T).T))
        return float(total)

    pairs = [(joints, ball) for joints in _MULTIPLES for ball in _MULTIPLES]
    evidence = np.array([likelihood(*pair) for pair in pairs])
    weight = np.exp(evidence - evidence.max())
    # Few repeats leave the scatter uncertain: its mean square over what is likely, not the likeliest.
    joints, ball = np.sqrt(weight @ np.array(pairs) ** 2 / weight.sum())
    return float(joints), float(ball)


def target_sd(repeated: Repeated, alike: NDArray[np.int64]) -> tuple[Array, bool]:
    """Standard deviation (N,) mm of readings at targets, and whether repeats show it; what moves all targets of a run
    together is not in it. alike (N,): a number that readings of the same place and approach share."""
    span, mean = _span(repeated.shaken), repeated.rows.mean(axis=0)
    apart = repeated.rows - mean
    # What the scatter of a run could do is taken off, and what is left made as large as it was before.
    free = np.maximum(1 - (span**2).sum(axis=1), _LEAST_FREE)
    rows = mean + (apart - (apart @ span) @ span.T) / np.sqrt(free)
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
    # Heavy tails and outliers do not move a median; each target's own scatter then has its say.
    common = max(1.4826 * float(np.median(np.abs(np.concatenate(away)))), 10 * _LEAST_MM)
    sd: Array = np.sqrt((_AGREEMENT * common**2 + squares) / (_AGREEMENT + freedom))
    return sd, True
