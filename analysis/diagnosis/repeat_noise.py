"""The noise of the readings, estimated from repeats: of each order of a circle, of each run, of each target, and of the
scatter between runs.

Between runs every joint and the ball change a little. This scatter moves all readings of a run together, in a way that
the arm's geometry determines, so repeated runs separate it from the noise of the readings. The noise has one shape over
the orders, pooled over all circles, and a level for each run, for slow and for fine orders, and for sum and difference
of the gauges. Without repeats, the noise of real cells is assumed (`analysis.noise.cell`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.observed_run import GRID, ORDER_OF, by_orders, curve
from analysis.fitting.observation import Observation, predicted, predicted_in_scene
from analysis.kinematics.arm import Array, Integers
from analysis.model.predict import Model, SetUp, moved
from analysis.noise.cell import BALL_MM, JOINT_DEG, SLOW_MM, TARGET_MM, WHITE_MM
from analysis.traces.tables import PoseTable
from rigs.effects import turned

SCATTER_DEG, SCATTER_MM = 0.0002, 0.001
"""The unit of scatter of joints and ball to which `scatter_response` refers; all scatter is a multiple of it. It has no
effect on the result."""
_MULTIPLES = np.array([0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 5.0, 8.0, 13.0, 21.0, 34.0])
"""Scatter that is tried, in these units; the largest exceeds that of real cells, 0.005° and 20 µm."""
_BANDS = (0, 4, 8, 12, 18, 30, 50, 90, 150, len(ORDER_OF))
"""Edges of the bands of orders in which the noise is pooled. Chosen: wide enough for several degrees of freedom per
band with two repeats."""
_SLOW = 30
"""Orders below this share a level, and so do those above: servo ripple and path errors are slow, the noise of a probe
is not. Chosen."""
_SLOW_HALF = 5.0
"""The order at which assumed slow noise has half its power: a correlation time of 1.5 s in a lap of 45 s, within the
0.1 to 5 s of real cells."""
DRIFTING_SHARE = 0.5
"""Share of the energy of a run's scatter that changes along the run, where nothing is measured: encoders and warming
move joints and ball smoothly. Repeats show that as slow noise, and few of them attribute all of it to a constant.
Chosen: one half."""
_DRIFT_ORDERS = 3
"""Orders of this change, in cycles per run. Chosen: slower than any joint motion of a circle."""
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
    """Repeated runs of one test and direction: `rows` (n, N) mm of n runs, the response (N, c) mm to a unit scatter,
    and the number of laps of which a row is the mean."""

    setup: str
    rows: Array
    response: Array
    laps: int = 1


@dataclass(frozen=True)
class CircleNoise:
    """Noise of circles. `sd_mm` has an array (n, N) for each block; `scattered` has the multiples of joint and ball
    scatter of each set-up; `measured` states whether they come from repeats."""

    sd_mm: tuple[Array, ...]
    scattered: dict[str, tuple[float, float]]
    measured: bool

    def scatter(self, setup: str, terms: int) -> Array:
        """Return the scatter (terms,) of the six joints in rad and then, if included, of the ball in mm. A set-up
        without circles gets the average of all."""
        every = np.sqrt(np.mean(np.array(list(self.scattered.values())) ** 2, axis=0))
        joints, ball = self.scattered.get(setup, (float(every[0]), float(every[1])))
        return np.array([joints] * 6 + [ball] * 3)[:terms]


def scatter_response(model: Model, one: Observation, setup: SetUp) -> Array:
    """Return the response of the readings, (m, k, 9) mm, to a unit scatter of each joint and of the ball; for poses,
    whose instrument frame is always fitted, of the joints alone, (m, 3, 6)."""
    scene = moved(model, one.path)
    base = predicted_in_scene(model, one, scene, setup)
    columns = []
    for axis in range(1, 7):
        off = replace(model, effects=(*model.effects, turned(axis, SCATTER_DEG)))
        columns.append(predicted(off, one, setup) - base)
    if not isinstance(one.table, PoseTable):
        steps = SCATTER_MM * np.eye(3)
        columns += [
            predicted_in_scene(model, one, scene, replace(setup, ball=setup.ball + step)) - base for step in steps
        ]
    return np.stack(columns, axis=2)


def circle_noise(groups: Sequence[Repeated], averaged: float) -> CircleNoise:
    """Return the noise of circles from the repeats `rows` (n, N) mm of each group. `averaged` is the share of the power
    of white noise that remains on the grid of a circle."""
    spans = [_span(group.response) for group in groups]
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
                _drifting(group.response * assumed.scatter(group.setup, group.response.shape[1]), group.laps),
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
        setup: _scatter([(apart[k], groups[k].response, sd_mm[k]) for k in own]) for setup, own in own_of.items()
    }
    return CircleNoise(sd_mm, scattered, measured=True)


_PART: Integers = np.asarray((np.arange(len(ORDER_OF)) >= len(ORDER_OF) // 2) * 2 + (ORDER_OF >= _SLOW), dtype=np.int64)
"""The index of an entry's level among the four levels of a run."""


def _assumed(averaged: float, laps: int) -> Array:
    """Return the assumed standard deviation (N,) mm of the entries of one run of some laps, from the noise of real
    cells."""
    count = len(ORDER_OF) // 2
    slow = 1 / (1 + (ORDER_OF / _SLOW_HALF) ** 2)
    # The energy of a channel of `count` unitary entries is `count` times the mean square of its readings.
    slow *= SLOW_MM.rms**2 / laps * count / slow[:count].sum()
    sd: Array = np.sqrt(WHITE_MM.rms**2 * averaged + slow)
    return sd


def _drifting(scatter_mm: Array, laps: int) -> Array:
    """Return the standard deviation (N,) mm, by bands, that a drifting scatter adds to the mean of some laps;
    `scatter_mm` (N, c) is the response to constant scatter."""
    angle = 2 * np.pi * np.arange(GRID) / GRID
    # The mean of laps contains only orders that repeat in each lap.
    orders = [order // laps for order in range(1, _DRIFT_ORDERS + 1) if order % laps == 0]
    variance = np.zeros(len(scatter_mm))
    still = np.stack([curve(column) for column in scatter_mm.T], axis=2)
    for wave in (turn(order * angle) for order in orders for turn in (np.cos, np.sin)):
        variance += DRIFTING_SHARE / _DRIFT_ORDERS * (by_orders(wave[:, None, None] * still) ** 2).sum(axis=1)
    for entries in _bands():
        variance[entries] = variance[entries].mean()
    sd: Array = np.sqrt(variance)
    return sd


def _bands() -> list[Integers]:
    """Return the indices of the entries of each channel and band in which noise is pooled."""
    half = len(ORDER_OF) // 2
    channels = (np.arange(half), np.arange(half, len(ORDER_OF)))
    bands = [(channel, low, high) for channel in channels for low, high in pairwise(_BANDS)]
    return [channel[(ORDER_OF[channel] >= low) & (ORDER_OF[channel] < high)] for channel, low, high in bands]


def _span(columns: Array) -> Array:
    """Return an orthonormal basis of columns (N, c), without directions that are nearly zero."""
    left, size, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(left[:, size > 1e-3 * size[0]], dtype=float)


def _shape(own: Sequence[Array], free: Sequence[Array]) -> Array:
    """Return the standard deviation (N,) of runs at level one, by channel and band, of the part that scatter cannot
    explain."""
    squares = sum((rows**2).sum(axis=0) for rows in own)
    freedom = sum((len(rows) - 1) * share for rows, share in zip(own, free, strict=True))
    shape = np.empty(len(ORDER_OF))
    for band in _bands():
        free_here = max(np.asarray(freedom)[band].sum(), 1.0)
        # Few repeats leave a band's noise uncertain: 1 + 2/ν is about the mean of its scaled inverse chi-square.
        shape[band] = np.sqrt(np.asarray(squares)[band].sum() / free_here * (1 + 2 / free_here))
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


def _scatter(repeated: Sequence[tuple[Array, Array, Array]]) -> tuple[float, float]:
    """Return the multiples of joint and ball scatter that make the differences between repeats most likely, given
    deviations (n, N), the response (N, 9) to a unit scatter and the noise (n, N) of each group."""
    looked = []
    for apart, response, each in repeated:
        sd = np.sqrt((each**2).mean(axis=0))
        columns = response / sd[:, None]
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
    # Few repeats leave the scatter uncertain, so the posterior mean square is used and not the mode.
    joints, ball = np.sqrt(weight @ np.array(pairs) ** 2 / weight.sum())
    return float(joints), float(ball)


def target_sd(repeated: Repeated, alike: NDArray[np.int64]) -> tuple[Array, bool]:
    """Return the standard deviation (N,) mm of readings at targets, and whether repeats determine it. The scatter that
    moves all targets of a run together is excluded. `alike` (N,) has an integer that readings of the same place and
    approach share."""
    span, mean = _span(repeated.response), repeated.rows.mean(axis=0)
    apart = repeated.rows - mean
    # The part that the scatter of a run explains is removed, and the rest is scaled to its original variance.
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
    # A median is robust against heavy tails and outliers; the target's own scatter then enters with its weight.
    common = max(1.4826 * float(np.median(np.abs(np.concatenate(away)))), 10 * _LEAST_MM)
    sd: Array = np.sqrt((_AGREEMENT * common**2 + squares) / (_AGREEMENT + freedom))
    return sd, True
