"""The uncertainty of parameters that were fitted, and which of them the readings determine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from analysis.geometry.circle import frame_of
from analysis.geometry.programs import circle_of
from analysis.inference.estimate import LAG_S, Weighting
from analysis.inference.observation import Observation, residuals_of
from analysis.kinematics.arm import Array, forward
from analysis.model.predict import Model, SetUp
from analysis.noise.cell import BALL_MM, JOINT_DEG, NoiseSource
from analysis.traces.tables import CircleTable, PoseTable
from rigs.effects import Effect, size_field, turned
from rigs.schema.effect import label_of

if TYPE_CHECKING:
    from analysis.inference.estimate import Fit

# ----------------------------------------------------------------------------------------------------------------------
# Identifiability: parameters that a fit does not determine, and those that it determines only in combination with
# others.
#
# The basis is the response of the fitted values to the true ones (the resolution matrix of ridge regression, in
# plausible sizes). Its diagonal is the share of a parameter that the readings and not the prior determine, and its
# rows show with which others a parameter is confounded.

UNIDENTIFIED = 0.05
"""Share of the response below which a parameter is not fitted, because the readings barely change its prior. Of
72 parameters in ten calibrations of two simulated arms, any value from 0.03 to 0.08 leaves out the same eleven."""
_IDENTIFIED = 0.9
"""Share of the response at and above which a parameter is determined by itself: its uncertainty is then that of the
readings alone to within 5 %. Five of those 72 parameters lie between 0.8 and 0.95."""
_CONFOUNDED = 0.1
"""Smallest share of a parameter's response that another must have to be listed with it. Any value from 0.09
to 0.2 lists the same of those 72 parameters; 0.05 lists five more."""
_HALF = 0.5
"""Share above which a combination of parameters counts as identified: the readings then determine more of it than the
prior."""


@dataclass(frozen=True)
class WeakParameter:
    """A parameter that the readings do not determine by themselves. `like` lists those it is confounded with; it is
    empty for one that is determined only roughly. `share` is the share of its response, 0 to 1."""

    what: str
    like: tuple[str, ...]
    share: float

    def __str__(self) -> str:
        if not self.share:
            return f"{self.what} is not determined by these readings and was not fitted"
        if not self.like:
            return f"{self.what} is known only roughly: the readings determine {self.share:.0%} of it"
        return f"{self.what} is determined only together with {' and '.join(self.like)}"


def identified_combinations(answer: Array) -> int:
    """Return how many combinations of parameters the readings determine, from the response (p, p), a share each."""
    return int((np.linalg.eigvals(answer).real > _HALF).sum()) if len(answer) else 0


def identified(answer: Array) -> list[int]:
    """Return the indices of the parameters that the readings determine well enough to fit, from the response (p, p), a
    share each."""
    return [k for k, share in enumerate(np.diag(answer)) if share >= UNIDENTIFIED]


def weak_parameters(answer: Array, names: Sequence[str]) -> list[WeakParameter]:
    """Return the parameters that the readings do not determine by themselves, from the response (p, p), a share
    each."""
    found = []
    for k, row in enumerate(answer):
        if row[k] < UNIDENTIFIED:
            found.append(WeakParameter(names[k], (), 0.0))
        elif row[k] < _IDENTIFIED:
            others = np.where(np.arange(len(row)) == k, 0.0, np.abs(row))
            order = np.argsort(-others)[:3]
            like = tuple(names[j] for j in order if others[j] > max(_CONFOUNDED, 0.2 * others.max()))
            found.append(WeakParameter(names[k], like, float(row[k])))
    return found


def parameter_label(effect: Effect, field: str) -> str:
    """Return the label of an effect, with the field where it is not its size."""
    return label_of(effect) if field == size_field(effect) else f"{label_of(effect)} {field}"


# ----------------------------------------------------------------------------------------------------------------------
# The uncertainty of fitted parameters when residuals are correlated and runs differ.
#
# Readings of one lap are correlated over some time, so the covariance of the least-squares solution is the sandwich
# estimator of Newey and West (1987), lag by lag within each run. Between runs every joint and the ball change a
# little; this scatter, from repeated runs or as in real cells, is propagated through the same solution.

_STEP_DEG, _STEP_MM = 1e-3, 5e-3
"""Steps of the derivatives by a joint and by the ball. Readings are linear over such steps."""
_BINS = 180
"""Places of a lap, 2° apart, at which repeated runs are compared. Chosen: the scatter of joints and ball is smoother.
"""
_JOINTS_DEG = np.array([0.0, *np.geomspace(0.1 * JOINT_DEG.low, 2 * JOINT_DEG.high, 16)])
"""Scatter of a joint that is tried: none, and a tenth of the smallest to twice the largest of real cells."""
_BALLS_MM = np.array([0.0, *np.geomspace(0.1 * BALL_MM.low, 2 * BALL_MM.high, 16)])
"""Scatter of the ball that is tried: none, and a tenth of the smallest to twice the largest of real cells."""


@dataclass(frozen=True)
class RunScatter:
    """The scatter of each joint and of the ball between runs, as standard deviations, and its source."""

    joint_deg: float
    ball_mm: float
    source: NoiseSource


def covariance(
    found: Fit, observations: Sequence[Observation], weighting: Weighting, background: Sequence[Effect]
) -> tuple[Array, RunScatter]:
    """Return the covariance (p, p) of the free parameters of a fit, in their own units, and the scatter between runs
    that it includes.

    The priors of a fit enter with their own uncertainty. `background` lists effects that are not fitted, each at most
    at its healthy size, because a fit attributes a part of each to its parameters.
    """
    J, model, setups = found.design, found.model, found.setups
    scatter = scatter_between_runs(model, observations, setups)
    residuals = weighting.weighted(found.residuals)
    inverse: Array = np.asarray(np.linalg.pinv(J.T @ J, rcond=1e-14))
    count = sum(residual.size for residual in residuals)
    used = float(np.sum(J[:count] @ inverse * J[:count]))
    shrink = count / max(1.0, count - used)
    meat = np.zeros((J.shape[1], J.shape[1]))
    begin = 0
    for k, (one, residual) in enumerate(zip(observations, residuals, strict=True)):
        rows = slice(begin, begin + residual.size)
        begin += residual.size
        meat += shrink * _newey_west(J[rows] * residual.ravel()[:, None], one, residual.shape[1])
        for response in _scatter_response(model, one, setups, scatter):
            score = J[rows].T @ (weighting.weights[k] * response).ravel()
            meat += np.outer(score, score)
    meat += J[begin:].T @ J[begin:]
    meat += _of_background(found, observations, weighting, background, J[:begin], inverse)
    scale = np.array([one.scale for one in found.free])
    own = (inverse @ meat @ inverse)[-len(scale) :, -len(scale) :]
    return own * np.outer(scale, scale), scatter


def _of_background(
    found: Fit,
    observations: Sequence[Observation],
    weighting: Weighting,
    background: Sequence[Effect],
    J: Array,
    inverse: Array,
) -> Array:
    """Return the contribution of effects that are not fitted to the covariance of the scores (p, p) of poses, at their
    healthy size or at the smaller level that explains the residual. Poses are few and far apart, so each of those
    effects has a different value at each pose, which resembles noise. On a lap it is smooth, and is included as
    correlation and scatter."""
    added = np.zeros((len(J), len(background)))
    begin = 0
    for place, (one, residual) in enumerate(zip(observations, found.residuals, strict=True)):
        rows = slice(begin, begin + residual.size)
        begin += residual.size
        if isinstance(one.table, PoseTable):
            for k, effect in enumerate(background):
                healthy = replace(found.model, effects=(*found.model.effects, effect))
                (there,) = residuals_of(healthy, [one], found.setups)
                added[rows, k] = (weighting.weights[place] * (there - residual)).ravel()
    scores = J.T @ added
    own = added.any(axis=1)
    left = (added - J @ (inverse @ scores))[own]
    residuals = np.concatenate([part.ravel() for part in weighting.weighted(found.residuals)])[own]
    level = min(1.0, float((residuals**2).sum()) / max(float((left**2).sum()), 1e-300))
    spread: Array = level * scores @ scores.T
    return spread


def scatter_between_runs(model: Model, observations: Sequence[Observation], setups: Mapping[str, SetUp]) -> RunScatter:
    """Return the most likely scatter of joints and ball, from the differences between repeated runs, of (m, k) mm, of
    one set-up and direction.

    The part of the differences that no scatter can explain (outside the span of its derivatives) is the noise against
    which it is weighted.
    """
    groups: dict[tuple[object, ...], list[Observation]] = {}
    for one in observations:
        if not isinstance(one.table, PoseTable):
            way = one.table.direction if isinstance(one.table, CircleTable) else len(one.rows)
            groups.setdefault((one.setup, type(one.table), way), []).append(one)
    unit = RunScatter(1.0, 1.0, "assumed")
    seen = []
    for repeats in groups.values():
        if len(repeats) < 2:
            continue
        left = [_at_common_places(model, one, *residuals_of(model, [one], setups)) for one in repeats]
        response = _scatter_response(model, repeats[0], setups, unit)
        columns = np.array([_at_common_places(model, repeats[0], column) for column in response]).T
        span, size, _ = np.linalg.svd(columns, full_matrices=False)
        span = span[:, size > 1e-3 * size[0]]
        apart = np.array(left) - np.mean(left, axis=0)
        inside = apart @ span
        freedom = (len(left) - 1) * (apart.shape[1] - span.shape[1])
        noise = float(((apart - inside @ span.T) ** 2).sum() / freedom)
        by = span.T @ columns
        seen.append((len(left) - 1, inside, noise, by[:, :6] @ by[:, :6].T, by[:, 6:] @ by[:, 6:].T))
    if not seen:
        return RunScatter(JOINT_DEG.rms, BALL_MM.rms, "assumed")

    def likelihood(joint: float, ball: float) -> float:
        total = 0.0
        for freedom, inside, noise, joints, balls in seen:
            C = noise * np.eye(len(joints)) + joint**2 * joints + ball**2 * balls
            total -= 0.5 * float(freedom * np.linalg.slogdet(C)[1] + np.sum(inside * np.linalg.solve(C, inside.T).T))
        return total

    joint, ball = max(((joint, ball) for joint in _JOINTS_DEG for ball in _BALLS_MM), key=lambda two: likelihood(*two))
    return RunScatter(float(joint), float(ball), "measured")


def _at_common_places(model: Model, one: Observation, values: Array) -> Array:
    """Return values (m, k) of a run at places that its repeats share: (BINS · k,) means around a circle; unchanged at
    targets."""
    if not isinstance(one.table, CircleTable):
        return values.ravel()
    phi = frame_of(circle_of(model.rig)).angle(forward(model.arm, one.table.q[one.rows])[:, :3, 3])
    turned = (phi % (2 * np.pi) * (_BINS / (2 * np.pi))).astype(np.int64) % _BINS
    counts = np.maximum(np.bincount(turned, minlength=_BINS), 1)
    return np.concatenate([np.bincount(turned, column, _BINS) / counts for column in values.T])


def _newey_west(scores: Array, one: Observation, channels: int) -> Array:
    """Return the sum (p, p) of the scores' (n, p) autocovariances over lags, with Bartlett's weights; at targets the
    scores are white."""
    total: Array = scores.T @ scores
    if not isinstance(one.table, CircleTable):
        return total
    per_row = scores.reshape(-1, channels, scores.shape[1]).sum(axis=1)
    total = per_row.T @ per_row
    step_s = float(np.median(np.diff(one.table.t_s[one.rows])))
    lags = min(len(per_row) // 4, int(LAG_S / max(step_s, 1e-6)))
    for lag in range(1, lags + 1):
        shifted = per_row[lag:].T @ per_row[:-lag]
        total = total + (1 - lag / (lags + 1)) * (shifted + shifted.T)
    return total


def _scatter_response(model: Model, one: Observation, setups: Mapping[str, SetUp], scatter: RunScatter) -> list[Array]:
    """Return the change of the readings (m, k) mm of one run for the scatter of each joint and of the ball along each
    axis."""
    if isinstance(one.table, PoseTable):
        return []
    (base,) = residuals_of(model, [one], setups)

    def change(moved: Model, placed: Mapping[str, SetUp]) -> Array:
        (changed,) = residuals_of(moved, [one], placed)
        return changed - base

    setup, found = setups[one.setup], []
    for axis in range(1, 7):
        moved = replace(model, effects=(*model.effects, turned(axis, _STEP_DEG)))
        found.append(change(moved, setups) * scatter.joint_deg / _STEP_DEG)
    for step in _STEP_MM * np.eye(3):
        placed = {**setups, one.setup: replace(setup, ball=setup.ball + step)}
        found.append(change(model, placed) * scatter.ball_mm / _STEP_MM)
    return found
