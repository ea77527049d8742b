"""Noise of runs estimated from repeats: scatter of joints and ball, noise of orders, runs and targets, late stamps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.evidence.observation import (
    GRID,
    ORDER_OF,
    ORDER_OF_TREND,
    STAMP_SCATTER,
    ObservedRun,
    Sampling,
    by_orders,
    predicted,
    predicted_in_scene,
)
from analysis.robot.kinematics.arm import Array, Integers
from analysis.robot.predict import SetUp, moved
from analysis.runs.noise.cell_noise import BALL_MM, JOINT_DEG, SLOW_MM, TARGET_MM, WHITE_MM
from rigs.effects import turned
from rigs.schema.vocabulary import MOST_AXES

# ----------------------------------------------------------------------------------------------------------------------
# Scatter of joints and ball between runs, which moves all readings of a run together.
#
# The geometry of the arm determines the response of the readings. A part of the scatter is constant in a run. The rest
# drifts along it, like encoders and temperature, in a few waves of unknown phase. Repeated runs determine both.

SCATTER_DEG, SCATTER_MM = 0.0002, 0.001
"""Unit of scatter of joints and ball in `scatter_response`, without influence on the result."""
_MULTIPLES = np.array([0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0])
"""Candidate values of the scatter in these units, beyond that of real cells, 0.005° and 20 µm. Chosen: few repeats do
not separate closer values.
"""
DRIFTING_SHARE = 0.5
"""Default share of a run's scatter energy that drifts along the run: encoders and warming move smoothly. Chosen."""
_SHARES = np.array([0.0, 0.3, 0.6, 0.9])
"""Shares tried with repeats. Chosen: a few runs do not separate closer values."""
_JOINTS_AND_BALL = (slice(None, -3), slice(-3, None))
"""Columns of a response belonging to the joints, and to the ball."""
_DRIFT_ORDERS = 3
"""Orders of the drift, in cycles per run. Chosen: slower than any joint motion of a circle."""
_SEEN = 0.1
"""Size in noise standard deviations below which a combination of scattered terms is ignored. Chosen: a hundredth of a
variance.
"""


@dataclass(frozen=True)
class RunScatter:
    """Scatter of the joints and of the ball between runs, in the units of `scatter_response`: constant in a run, and
    drifting.
    """

    joints: float
    ball: float
    drifting_joints: float
    drifting_ball: float

    def constant(self, terms: int) -> Array:
        """Constant scatter of each joint and of the ball in x, y, z (terms,)."""
        return _by_term(self.joints, self.ball, terms)

    def drifting(self, terms: int) -> Array:
        return _by_term(self.drifting_joints, self.drifting_ball, terms)


def _by_term(joints: float, ball: float, terms: int) -> Array:
    scatter = np.full(terms, joints)
    if terms > MOST_AXES:
        scatter[-3:] = ball
    return scatter


ASSUMED_SCATTER = RunScatter(
    JOINT_DEG.rms / SCATTER_DEG,
    BALL_MM.rms / SCATTER_MM,
    float(np.sqrt(DRIFTING_SHARE)) * JOINT_DEG.rms / SCATTER_DEG,
    float(np.sqrt(DRIFTING_SHARE)) * BALL_MM.rms / SCATTER_MM,
)
"""Scatter of real cells."""


def scatter_response(run: ObservedRun, setup: SetUp) -> Array:
    """Response of the readings, (m, k, axes + 3) mm, to a unit scatter of each joint and of the ball; for poses, whose
    instrument frame is always fitted, of the joints only.
    """
    model, scene = run.model, moved(run.model, run.path)
    base, columns = predicted_in_scene(model, run, scene, setup), []
    for axis in range(1, model.arm.axes + 1):
        off = replace(model, effects=(*model.effects, turned(axis, SCATTER_DEG)))
        columns.append(predicted(replace(run, model=off), setup) - base)
    if not run.facts.of_places:
        places = [replace(setup, ball=setup.ball + step) for step in SCATTER_MM * np.eye(3)]
        columns += [predicted_in_scene(model, run, scene, place) - base for place in places]
    return np.stack(columns, axis=2)


def drift_waves(share: Array) -> Array:
    """Waves (w, m) of a unit drift along the run, at the share (m,) of its duration."""
    turns = 2 * np.pi * np.arange(1, _DRIFT_ORDERS + 1)[:, None] * share
    return np.asarray(np.concatenate([np.cos(turns), np.sin(turns)]) / np.sqrt(_DRIFT_ORDERS), dtype=float)


@dataclass(frozen=True, eq=False)
class Repeated:
    """n repeated runs with the same test and direction."""

    setup: str
    rows: Array
    """Readings (n, N) mm."""
    response: Array
    """Response (N, axes + 3) mm to a unit scatter of joints and ball."""
    drifting: Array
    """The same (w, N, axes + 3) for each wave of a drift."""
    laps: int
    stamps: Array
    """Response (N, s) mm to a standard deviation of stamp scatter at a few angles."""

    @cached_property
    def deviations_mm(self) -> Array:
        return np.asarray(self.rows - self.rows.mean(axis=0), dtype=float)

    def of_laps(self) -> Repeated:
        """Only the laps, without standstills and the trend, which follow the orders."""
        laps = slice(len(ORDER_OF))
        return replace(
            self, rows=self.rows[:, laps], response=self.response[laps], drifting=self.drifting[:, laps],
            stamps=self.stamps[laps],
        )  # fmt: skip

    def noise(self, scatter: RunScatter, sd_mm: Array) -> tuple[Array, Array]:
        """Expected noise part (n, N) mm of the deviations, for noise of sd_mm (N,), and the share (N,) of the noise."""
        columns, taken = self._regression(scatter, sd_mm)
        noise: Array = self.deviations_mm - (self.deviations_mm / sd_mm) @ taken.T @ columns.T * sd_mm
        return noise, 1 - np.einsum("nc,cn->n", columns, taken)

    def without_stamps(self, scatter: RunScatter, sd_mm: Array) -> Array:
        if not self.stamps.size:
            return self.deviations_mm
        _, taken = self._regression(scatter, sd_mm)
        stamps = taken[taken.shape[0] - self.stamps.shape[1] :]
        return self.deviations_mm - (self.deviations_mm / sd_mm) @ stamps.T @ self.stamps.T

    def _regression(self, scatter: RunScatter, sd_mm: Array) -> tuple[Array, Array]:
        """Response (N, c) to a standard deviation of scatter and stamps, relative to the noise sd_mm (N,), and the
        estimator (c, N) of their coefficients.
        """
        scattered = scatter_columns(self.response, self.drifting, scatter)
        columns = np.concatenate([scattered, self.stamps], axis=1) / sd_mm[:, None]
        normal = columns.T @ columns
        normal[np.diag_indices_from(normal)] += 1.0
        return columns, np.asarray(np.linalg.solve(normal, columns.T), dtype=float)


def scatter_columns(constant: Array, drifting: Array, scatter: RunScatter) -> Array:
    """Response (N, c + c w) mm to a standard deviation of scatter, from constant (N, c) and drifting (w, N, c) mm."""
    terms = constant.shape[1]
    return np.concatenate([constant * scatter.constant(terms), *(drifting * scatter.drifting(terms))], axis=1)


def without_unseen(columns: Array, sd_mm: Array) -> Array:
    """Fewer columns (N, r) mm with the same covariance, apart from parts much smaller than the noise sd_mm (N,)."""
    directions, size, _ = np.linalg.svd(columns / sd_mm[:, None], full_matrices=False)
    seen = size > _SEEN
    return np.asarray(directions[:, seen] * size[seen] * sd_mm[:, None], dtype=float)


def unscattered(apart: Array, columns: Array) -> tuple[Array, Array]:
    """The part (n, N) mm of deviations (n, N) mm that columns (N, c) cannot explain, and its share (N,) of the
    noise.
    """
    span = _span_of(columns)
    return apart - (apart @ span) @ span.T, 1 - (span**2).sum(axis=1)


def _span_of(columns: Array) -> Array:
    squares, directions = np.linalg.eigh(columns.T @ columns)
    seen = squares > 1e-10 * squares[-1]
    return np.asarray(columns @ (directions[:, seen] / np.sqrt(squares[seen])), dtype=float)


def scatter_of(repeated: Sequence[tuple[Repeated, Array]]) -> RunScatter:
    """Scatter that best explains the differences between repeated runs, given the noise (N,) mm of each group. Few
    repeats leave it uncertain, so it is the posterior mean square instead of the likeliest value.
    """
    joints, ball, share = (axis.ravel() for axis in np.meshgrid(_MULTIPLES, _MULTIPLES, _SHARES, indexing="ij"))
    squares = np.stack([joints**2 * (1 - share), ball**2 * (1 - share), joints**2 * share, ball**2 * share], axis=1)
    evidence = np.zeros(len(squares))
    for runs, sd_mm in repeated:
        constant, drifting = runs.response / sd_mm[:, None], runs.drifting / sd_mm[:, None]
        stamps = runs.stamps / sd_mm[:, None]
        span = _span_of(np.concatenate([constant, *drifting, stamps], axis=1))
        waves = [drifting[:, :, columns].transpose(1, 0, 2).reshape(len(constant), -1) for columns in _JOINTS_AND_BALL]
        inside = [span.T @ part for part in (*(constant[:, columns] for columns in _JOINTS_AND_BALL), *waves)]
        C = np.tensordot(squares, np.stack([part @ part.T for part in inside]), axes=1)
        C += np.eye(span.shape[1]) + (span.T @ stamps) @ (span.T @ stamps).T
        Z = (runs.deviations_mm / sd_mm) @ span
        cost = np.einsum("nr,srn->s", Z, np.linalg.solve(C, np.broadcast_to(Z.T, (len(C), *Z.T.shape))))
        evidence += -0.5 * ((len(Z) - 1) * np.linalg.slogdet(C)[1] + cost)
    weight = np.exp(evidence - np.max(evidence))
    return RunScatter(*np.sqrt(weight @ squares / weight.sum()).tolist())


# ----------------------------------------------------------------------------------------------------------------------
# Noise of the readings from repeats: of each order of a circle, of each run and of each target.
#
# Repeated runs separate it from the scatter of joints and ball between runs (`RunScatter`). The noise of a set-up has a
# common shape over the orders, and a level per run, for slow and fine orders, and for sum and difference of the gauges.
# If no runs are repeated, the noise of real cells is assumed (`analysis.runs.noise.cell_noise`).

_BANDS = (0, 4, 8, 12, 18, 30, 50, 90, 150, len(ORDER_OF))
"""Edges of the bands of orders with pooled noise. Chosen: several degrees of freedom per band with two repeats."""
_SLOW = 30
"""Orders below this share a level, and so do the others: servo ripple is slow, probe noise is not. Chosen."""
_SLOW_CORNER = 5.0
"""Order at which assumed slow noise has half its power: a correlation time of 1.5 s in a lap of 45 s; real cells have
0.1 to 5 s.
"""
_NOISE_ROUNDS = 4
"""Rounds of alternating noise and scatter estimates. Chosen: more change less than the uncertainty."""
PRIOR_FREEDOM = 4.0
"""Degrees of freedom of the expected variance in an estimate from few repeats: of the finer neighbour of a band, or of
all targets (Smyth 2004). Chosen: permits the tenfold differences between targets of real cells.
"""
_LEAST_MM = 1e-5
"""Smallest standard deviation of an entry, well below any gauge: exact repeats do not give infinite weights."""
_LEAST_FREE = 0.1
"""Smallest remaining share of a reading after removing the scatter of a run. Chosen: limits the correction."""
LEAST_ASSUMED = (TARGET_MM.low / TARGET_MM.rms) ** 2
"""Smallest power of assumed noise, relative to the mean: the lower bound of real cells."""


@dataclass(frozen=True)
class CircleNoise:
    """Noise of circles. `sd_mm`: array (n, N) per block. `measured`: estimated from repeats."""

    sd_mm: tuple[Array, ...]
    scattered: dict[str, RunScatter]
    measured: bool

    def scatter(self, setup: str) -> RunScatter:
        """Scatter of a set-up; the average of all if the set-up has no repeated circles."""
        if setup in self.scattered:
            return self.scattered[setup]
        squares = np.array([astuple(scatter) for scatter in self.scattered.values()]) ** 2
        return RunScatter(*np.sqrt(np.mean(squares, axis=0)).tolist())


def circle_noise(groups: Sequence[Repeated], averaged: float) -> CircleNoise:
    """Noise of circles from the repeats of each group. `averaged`: share of white noise power remaining on the grid."""
    repeated: dict[str, list[int]] = {}
    for k, group in enumerate(groups):
        if len(group.rows) > 1:
            repeated.setdefault(group.setup, []).append(k)
    if not repeated:
        # Noise of real cells. Drifting scatter, inseparable from the noise of a single run, is included by bands.
        assumed, count = [], len(ORDER_OF) // 2
        for group in groups:
            slow = 1 / (1 + (ORDER_OF / _SLOW_CORNER) ** 2)
            # The energy of a channel of `count` unitary entries is `count` times the mean square of its readings.
            slow *= SLOW_MM.rms**2 / group.laps * count / slow[:count].sum()
            drifting = ((group.drifting * ASSUMED_SCATTER.drifting(group.response.shape[1])) ** 2).sum(axis=(0, 2))
            for entries in _bands():
                drifting[entries] = drifting[entries].mean()
            sd = np.sqrt(WHITE_MM.rms**2 * averaged + slow + drifting)
            assumed.append(np.tile(sd, (len(group.rows), 1)))
        return CircleNoise(tuple(assumed), {"": ASSUMED_SCATTER}, measured=False)
    sd_mm: dict[int, Array] = {}
    scattered = {}
    for setup, members in repeated.items():
        levels, scattered[setup] = _setup_noise([groups[k] for k in members])
        sd_mm.update(zip(members, levels, strict=True))
    # A run with no repeats takes the noise of the set-up, or otherwise of all.
    every = list(sd_mm)
    for k, group in enumerate(groups):
        lenders = repeated.get(group.setup, every)
        borrowed = np.sqrt(np.mean(np.concatenate([sd_mm[lender] for lender in lenders]) ** 2, axis=0))
        sd_mm.setdefault(k, np.tile(borrowed, (len(group.rows), 1)))
    return CircleNoise(tuple(sd_mm[k] for k in range(len(groups))), scattered, measured=True)


def _setup_noise(every: Sequence[Repeated]) -> tuple[list[Array], RunScatter]:
    """Noise (n, N) mm of the runs of each repeated group of a set-up, and their scatter, estimated alternately. The
    first round takes the noise from the part that scatter cannot explain.
    """
    parts = [unscattered(runs.deviations_mm, np.concatenate([runs.response, *runs.drifting], axis=1)) for runs in every]
    levels = [np.ones((len(runs.deviations_mm), 4)) for runs in every]
    for _ in range(_NOISE_ROUNDS):
        for _ in range(2):
            shape = _shape(
                [rows / level[:, _PART] for (rows, _), level in zip(parts, levels, strict=True)],
                [free for _, free in parts],
            )
            levels = [_levels(rows / shape, free) for rows, free in parts]
        sd_mm = [np.maximum(shape * level[:, _PART], _LEAST_MM) for level in levels]
        typical = [np.sqrt((sd**2).mean(axis=0)) for sd in sd_mm]
        scatter = scatter_of(list(zip(every, typical, strict=True)))
        parts = [runs.noise(scatter, sd) for runs, sd in zip(every, typical, strict=True)]
    return sd_mm, scatter


_PART: Integers = np.asarray((np.arange(len(ORDER_OF)) >= len(ORDER_OF) // 2) * 2 + (ORDER_OF >= _SLOW), dtype=np.int64)
"""Index of an entry's level among the four levels of a run."""


def _bands() -> list[Integers]:
    per_channel = len(ORDER_OF) // 2
    channels = (np.arange(per_channel), np.arange(per_channel, len(ORDER_OF)))
    bands = [(channel, low, high) for channel in channels for low, high in pairwise(_BANDS)]
    return [channel[(ORDER_OF[channel] >= low) & (ORDER_OF[channel] < high)] for channel, low, high in bands]


def _shape(unexplained: Sequence[Array], free: Sequence[Array]) -> Array:
    """Standard deviation (N,) of runs at level 1, by channel and band, of the part unexplained by scatter.

    Scatter may hide nearly all of the slowest orders, and few repeats leave every band uncertain. Each band therefore
    includes the finer neighbour as additional readings: slow noise increases towards slow orders.
    """
    squares = np.asarray(sum((rows**2).sum(axis=0) for rows in unexplained))
    freedom = np.asarray(sum((len(rows) - 1) * share for rows, share in zip(unexplained, free, strict=True)))
    shape, finer = np.empty(len(ORDER_OF)), 0.0
    for band in reversed(_bands()):
        extra = PRIOR_FREEDOM if ORDER_OF[band].max() < ORDER_OF.max() else 0.0
        seen = freedom[band].sum() + extra
        # The scaled inverse chi-square has a mean of about 1 + 2/ν.
        variance = (squares[band].sum() + extra * finer) / seen * (1 + 2 / seen)
        shape[band], finer = np.sqrt(variance), variance
    return np.maximum(shape, _LEAST_MM)


def _levels(rows: Array, free: Array) -> Array:
    """Levels (n, 4) of repeated runs, from their deviations (n, N) from the mean divided by the shape of the noise.

    With variances σ_r² of n runs, the expected mean square of a run's deviation is σ_r² (1 - 2/n) + Σ σ²/n².
    """
    n = len(rows)
    q = np.stack([(rows[:, part == _PART] ** 2).sum(axis=1) / free[part == _PART].sum() for part in range(4)], axis=1)
    total = q.sum(axis=0) * n / (n - 1)
    if n < 3:
        return np.tile(np.maximum(np.sqrt(total / n), _LEAST_MM), (n, 1))
    each = (q - total / n**2) / (1 - 2 / n)
    # The estimate for the quietest of few runs can be zero; the minimum is a quarter of their mean level.
    return np.asarray(np.maximum(np.sqrt(np.maximum(each, total / n / 16)), _LEAST_MM), dtype=float)


def target_sd(rows_mm: Array, response: Array, alike: NDArray[np.int64]) -> tuple[Array, bool]:
    """Standard deviation (N,) mm of readings at targets of repeated runs (n, N) mm, and whether repeats determine it.

    Scatter common to all targets of a run, with a response (N, c), is excluded. `alike` (N,): equal integers for
    readings of the same place and approach.
    """
    mean = rows_mm.mean(axis=0)
    unexplained, free = unscattered(rows_mm - mean, response)
    # The part explained by the scatter of a run is removed, and the rest is scaled to its original variance.
    rows = mean + unexplained / np.sqrt(np.maximum(free, _LEAST_FREE))
    squares, freedom = np.zeros(rows.shape[1]), np.zeros(rows.shape[1])
    away = []
    for number in np.unique(alike):
        visits = np.flatnonzero(alike == number)
        group = rows[:, visits]
        if group.size > 1:
            off = (group - group.mean()) * np.sqrt(group.size / (group.size - 1))
            away.append(off.ravel())
            squares[visits] = (off**2).sum() * (group.size - 1) / group.size
            freedom[visits] = group.size - 1
    if not away:
        return np.full(rows.shape[1], TARGET_MM.rms), False
    # A median is robust against heavy tails and outliers. The scatter of each target is then combined with it by
    # weight.
    common = max(1.4826 * float(np.median(np.abs(np.concatenate(away)))), 10 * _LEAST_MM)
    sd: Array = np.sqrt((PRIOR_FREEDOM * common**2 + squares) / (PRIOR_FREEDOM + freedom))
    return sd, True


# ----------------------------------------------------------------------------------------------------------------------
# Noise of stamps during changes of the readings within milliseconds: while a joint crosses wide backlash, a stamp
# delayed by a millisecond causes an error of a tenth of a millimetre.
#
# Elsewhere, scattering stamps add uniform noise, visible in repeats. Here a few angles carry a thousand times as much,
# which would raise the noise of all orders.

_RARE = 5.0
"""Ratio of the noise at an angle to the median noise of the lap, above which the angle is treated separately. Chosen:
the steepest part of a wave has 1.4 times the median; ten would leave half of a backlash crossing in the noise of the
orders.
"""
_MOST = GRID // 16
"""Largest number of angles of a lap treated separately. Chosen: twice as many columns gain a few per cent."""
_LEAST_LATE_MM = 1e-4
"""Noise in mm below which no angle is treated separately: a digit of the finest gauges of such a link."""


def stamp_noise(samplings: Sequence[Sampling], t_s: Sequence[Array], readings_mm: Sequence[Array]) -> Array:
    """Response (N, c) mm of the entries of a lap to a standard deviation of stamp scatter: a column for each angle of
    the grid with fast changes.

    The readings of the model, (m, 2) mm at times (m,) s for each of several repeated runs, give the rate of change.
    Rows of fast gauges are means of many readings with less scatter, but a crossing shorter than a row causes an error
    of this size in such rows, too.
    """
    laps, none = [], np.zeros((1, 2))
    for sampling, t, readings in zip(samplings, t_s, readings_mm, strict=True):
        count = len(sampling.phi)
        steps, passed_s = np.diff(readings[:count], axis=0), np.diff(t[:count])[:, None]
        # A step between two readings is equally steep for both. Readings with the same stamp have no slope.
        slopes = np.divide(steps, passed_s, out=np.zeros_like(steps), where=passed_s > 0)
        before, after = np.concatenate([none, slopes]), np.concatenate([slopes, none])
        late_s = STAMP_SCATTER * float(np.median(passed_s))
        laps.append((sampling, late_s * np.where(np.abs(before) > np.abs(after), before, after)))
    sd_mm = np.sqrt(np.mean([sampling.gridded_sd(off_mm) ** 2 for sampling, off_mm in laps], axis=0))
    way = np.sign(sum(sampling.gridded(off_mm) for sampling, off_mm in laps))
    most = sd_mm.max(axis=1)
    angles = np.argsort(-most)[:_MOST]
    angles = angles[most[angles] > max(_RARE * float(np.median(most)), _LEAST_LATE_MM)]
    single = np.zeros((GRID, 2, len(angles)))
    # Both gauges are stamped together.
    single[angles, :, np.arange(len(angles))] = (way * sd_mm)[angles]
    others = 2 * len(samplings[0].stands) + (len(ORDER_OF_TREND) if len(samplings[0].trend) else 0)
    return np.concatenate([by_orders(single), np.zeros((others, len(angles)))])
