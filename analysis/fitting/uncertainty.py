"""How well fitted parameters are known, when the residuals are not white and no two runs are quite alike.

Readings of one lap are correlated over some time: the covariance of the least-squares solution is the sandwich of
Newey and West (1987), lag by lag within each run. And from run to run every joint and the ball sit a little elsewhere:
that scatter, as repeated runs show it or as real cells have it, goes through the same solution.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from analysis.fitting.observation import Observation, residuals_of
from analysis.fitting.run_noise import LAG_S
from analysis.fitting.weighing import Weighing
from analysis.geometry.circle import frame_of
from analysis.geometry.programs import circle_of
from analysis.kinematics.arm import Array, forward
from analysis.model.predict import Model, SetUp
from analysis.noise.cell import BALL_MM, JOINT_DEG, NoiseSource
from analysis.traces.tables import CircleTable, PoseTable
from rigs.effects import Effect, turned

if TYPE_CHECKING:
    from analysis.fitting.estimate import Fit

_STEP_DEG, _STEP_MM = 1e-3, 5e-3
"""Steps of the derivatives by a joint and by the ball: readings are straight in so little."""
_BINS = 180
"""Places of a lap, 2° apart, at which repeated runs are laid over each other."""
_JOINTS_DEG = np.array([0.0, *np.geomspace(0.1 * JOINT_DEG.low, 2 * JOINT_DEG.high, 16)])
_BALLS_MM = np.array([0.0, *np.geomspace(0.1 * BALL_MM.low, 2 * BALL_MM.high, 16)])


@dataclass(frozen=True)
class Scatter:
    """How far each joint and the ball lie elsewhere from run to run, standard deviations, and where that is from."""

    joint_deg: float
    ball_mm: float
    source: NoiseSource


def covariance(
    found: Fit, observations: Sequence[Observation], weighing: Weighing, background: Sequence[Effect]
) -> tuple[Array, Scatter]:
    """Covariance (p, p) of the free parameters of a fit, in their own units, and the scatter from run to run in it.

    What the priors of a fit say counts as one more thing that is known no better than they say. background: effects
    that are not fitted, each as large as a healthy arm has it, or smaller: a fit takes a part of each for its own.
    """
    J, model, setups = found.design, found.model, found.setups
    scatter = scatter_between(model, observations, setups)
    residuals = weighing.weighed(found.residuals)
    inverse: Array = np.asarray(np.linalg.pinv(J.T @ J, rcond=1e-14))
    count = sum(residual.size for residual in residuals)
    used = float(np.einsum("ij,jk,ik->", J[:count], inverse, J[:count]))
    shrink = count / max(1.0, count - used)
    meat = np.zeros((J.shape[1], J.shape[1]))
    begin = 0
    for k, (one, residual) in enumerate(zip(observations, residuals, strict=True)):
        rows = slice(begin, begin + residual.size)
        begin += residual.size
        meat += shrink * _newey_west(J[rows] * residual.ravel()[:, None], one, residual.shape[1])
        for shaken in _shaken(model, one, setups, scatter):
            score = J[rows].T @ (weighing.weights[k] * shaken).ravel()
            meat += np.outer(score, score)
    meat += J[begin:].T @ J[begin:]
    meat += _of_background(found, observations, weighing, background, J[:begin], inverse)
    scale = np.array([one.scale for one in found.free])
    own = (inverse @ meat @ inverse)[-len(scale) :, -len(scale) :]
    return own * np.outer(scale, scale), scatter


def _of_background(
    found: Fit,
    observations: Sequence[Observation],
    weighing: Weighing,
    background: Sequence[Effect],
    J: Array,
    inverse: Array,
) -> Array:
    """What effects that are not fitted add to the scores (p, p) of poses: at their healthy size, or at the level at
    which they would leave as much as is left. Poses are few and far apart: each of those effects has its own value at
    each of them, which looks like noise. On a lap it is smooth, and what is smooth counts as memory and scatter."""
    added = np.zeros((len(J), len(background)))
    begin = 0
    for place, (one, residual) in enumerate(zip(observations, found.residuals, strict=True)):
        rows = slice(begin, begin + residual.size)
        begin += residual.size
        if isinstance(one.table, PoseTable):
            for k, effect in enumerate(background):
                healthy = replace(found.model, effects=(*found.model.effects, effect))
                (there,) = residuals_of(healthy, [one], found.setups)
                added[rows, k] = (weighing.weights[place] * (there - residual)).ravel()
    scores = J.T @ added
    own = added.any(axis=1)
    left = (added - J @ (inverse @ scores))[own]
    residuals = np.concatenate([part.ravel() for part in weighing.weighed(found.residuals)])[own]
    level = min(1.0, float((residuals**2).sum()) / max(float((left**2).sum()), 1e-300))
    spread: Array = level * scores @ scores.T
    return spread


def scatter_between(model: Model, observations: Sequence[Observation], setups: Mapping[str, SetUp]) -> Scatter:
    """The most likely scatter of joints and ball, from what repeated runs of one set-up and direction differ by.

    What no scatter can have done (outside the span of its derivatives) is the noise that it is weighed against.
    """
    groups: dict[tuple[object, ...], list[Observation]] = {}
    for one in observations:
        if not isinstance(one.table, PoseTable):
            way = one.table.direction if isinstance(one.table, CircleTable) else len(one.rows)
            groups.setdefault((one.setup, type(one.table), way), []).append(one)
    unit = Scatter(1.0, 1.0, "assumed")
    seen = []
    for repeats in groups.values():
        if len(repeats) < 2:
            continue
        left = [_laid_over(model, one, *residuals_of(model, [one], setups)) for one in repeats]
        shaken = _shaken(model, repeats[0], setups, unit)
        columns = np.array([_laid_over(model, repeats[0], column) for column in shaken]).T
        span, size, _ = np.linalg.svd(columns, full_matrices=False)
        span = span[:, size > 1e-3 * size[0]]
        apart = np.array(left) - np.mean(left, axis=0)
        inside = apart @ span
        freedom = (len(left) - 1) * (apart.shape[1] - span.shape[1])
        noise = float(((apart - inside @ span.T) ** 2).sum() / freedom)
        by = span.T @ columns
        seen.append((len(left) - 1, inside, noise, by[:, :6] @ by[:, :6].T, by[:, 6:] @ by[:, 6:].T))
    if not seen:
        return Scatter(JOINT_DEG.rms, BALL_MM.rms, "assumed")

    def likelihood(joint: float, ball: float) -> float:
        total = 0.0
        for freedom, inside, noise, joints, balls in seen:
            C = noise * np.eye(len(joints)) + joint**2 * joints + ball**2 * balls
            total -= 0.5 * float(freedom * np.linalg.slogdet(C)[1] + np.sum(inside * np.linalg.solve(C, inside.T).T))
        return total

    joint, ball = max(((joint, ball) for joint in _JOINTS_DEG for ball in _BALLS_MM), key=lambda two: likelihood(*two))
    return Scatter(float(joint), float(ball), "measured")


def _laid_over(model: Model, one: Observation, values: Array) -> Array:
    """Values (m, k) of a run where repeats have theirs too: (BINS · k,) means around the circle; at targets as they
    are."""
    if not isinstance(one.table, CircleTable):
        return values.ravel()
    phi = frame_of(circle_of(model.rig)).angle(forward(model.arm, one.table.q[one.rows])[:, :3, 3])
    turned = (phi % (2 * np.pi) * (_BINS / (2 * np.pi))).astype(np.int64) % _BINS
    counts = np.maximum(np.bincount(turned, minlength=_BINS), 1)
    return np.concatenate([np.bincount(turned, column, _BINS) / counts for column in values.T])


def _newey_west(scores: Array, one: Observation, channels: int) -> Array:
    """Sum of the scores' (n, p) autocovariances over lags, with Bartlett's weights; white at targets."""
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


def _shaken(model: Model, one: Observation, setups: Mapping[str, SetUp], scatter: Scatter) -> list[Array]:
    """What the scatter of each joint and of the ball along each axis adds to the readings (m, k) of one run."""
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
