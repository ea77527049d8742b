"""How well fitted parameters are known, when the residuals are not white and no two runs are quite alike.

Readings of one lap are correlated over some time: the covariance of the least-squares solution is the sandwich of
Newey and West (1987), lag by lag within each run. And from run to run every joint and the ball sit a little
elsewhere: that scatter, of the size a good cell shows, goes through the same solution.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from analysis.fitting.observation import Observation, residuals_of
from analysis.kinematics.arm import Array
from analysis.model.predict import Model, SetUp
from analysis.model.simulate import Noise
from analysis.reading.tables import CircleTable, PoseTable
from rigs.effects import JointOffset

_LAG_S = 2.5
"""Residuals further apart in time have forgotten each other."""


def covariance(
    J: Array, model: Model, observations: Sequence[Observation], setups: dict[str, SetUp], shrink: float
) -> Array:
    """Covariance (p, p) of all unknowns of a fit.

    J (N, p): derivatives of all residuals, run after run, the rows of the prior last; shrink: N / (N - p).
    """
    inverse = np.linalg.pinv(J.T @ J, rcond=1e-14)
    residuals = residuals_of(model, observations, setups)
    meat = np.zeros((J.shape[1], J.shape[1]))
    begin = 0
    for one, residual in zip(observations, residuals, strict=True):
        rows = slice(begin, begin + residual.size)
        begin += residual.size
        meat += shrink * _newey_west(J[rows] * residual.ravel()[:, None], one, residual.shape[1])
        meat += _scatter(J[rows], model, one, setups)
    prior = J[begin:]
    meat += prior.T @ prior * float(np.mean(np.concatenate([r.ravel() for r in residuals]) ** 2))
    return inverse @ meat @ inverse


def _newey_west(scores: Array, one: Observation, channels: int) -> Array:
    """Sum of the scores' (n, p) autocovariances over lags, with Bartlett's weights; white at targets."""
    total: Array = scores.T @ scores
    if not isinstance(one.table, CircleTable):
        return total
    per_row = scores.reshape(-1, channels, scores.shape[1]).sum(axis=1)
    total = per_row.T @ per_row
    step_s = float(np.median(np.diff(one.table.t_s[one.rows])))
    lags = min(len(per_row) // 4, int(_LAG_S / max(step_s, 1e-6)))
    for lag in range(1, lags + 1):
        shifted = per_row[lag:].T @ per_row[:-lag]
        total = total + (1 - lag / (lags + 1)) * (shifted + shifted.T)
    return total


def _scatter(J: Array, model: Model, one: Observation, setups: dict[str, SetUp]) -> Array:
    """What the scatter of joints and ball from run to run adds, as scores of one run."""
    if isinstance(one.table, PoseTable):
        return np.zeros((J.shape[1], J.shape[1]))
    good = Noise()
    (base,) = residuals_of(model, [one], setups)

    def score(change: Callable[[], list[Array]]) -> Array:
        (changed,) = change()
        return J.T @ (changed - base).ravel()

    scores = []
    for axis in range(1, 7):
        moved = replace(model, effects=(*model.effects, JointOffset(axis=axis, offset_deg=good.scatter_deg)))
        scores.append(score(lambda moved=moved: residuals_of(moved, [one], setups)))  # type: ignore[misc]
    setup = setups[one.setup]
    for step in good.scatter_mm * np.eye(3):
        placed = setups | {one.setup: replace(setup, ball=setup.ball + step)}
        scores.append(score(lambda placed=placed: residuals_of(model, [one], placed)))  # type: ignore[misc]
    stacked = np.array(scores)
    total: Array = stacked.T @ stacked
    return total
