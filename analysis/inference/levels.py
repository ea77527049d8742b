"""Levels by evidence: strengths of the noise and of groups of coefficients that the readings themselves show.

A level multiplies the prior variances of a group of coefficients and, as a standard deviation, their prior means. The
logarithms θ of all noise variances and levels have a normal prior; `fit_levels` maximises

    log p(y | θ) − ½ Σ_k [(θ_k − median_k) / width_k]²

with the gradient that one factor gives for all of them (MacKay, Neural Computation 4, 1992).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.inference.linear_model import (
    ByBand,
    Indices,
    LinearModel,
    Matrix,
    Posterior,
    Prior,
    condition,
)

Logs = NDArray[np.float64]
"""Natural logarithms (b + l,) of the noise variances of the bands, then of the levels of the groups."""
_MOST_STEPS = 60
"""Largest number of evaluations. Chosen: fits of ten levels end after 10 to 30."""
_STEP = 2e-3
"""Step of a logarithm for the curvature: the slope is exact, so that its differences lose three digits."""


@dataclass(frozen=True, eq=False)
class LevelPrior:
    """Normal prior of the logarithms, with limits. An infinite width states no preference."""

    median: Logs
    width: Logs
    low: Logs
    high: Logs


@dataclass(frozen=True, eq=False)
class Levels:
    """Noise variances (b,) and levels (l,), with the posterior at these."""

    logs: Logs
    posterior: Posterior

    @property
    def noise(self) -> ByBand:
        return self.posterior.noise

    @property
    def level(self) -> NDArray[np.float64]:
        return np.exp(self.logs[len(self.noise) :])


def scaled_prior(prior: Prior, group: Indices, level: NDArray[np.float64]) -> Prior:
    """Multiply the variances of each group by its level; a group of -1 has a fixed prior.

    >>> scaled_prior(Prior(np.ones(3), np.ones(3)), np.array([0, 0, -1]), np.array([4.0])).mean
    array([2., 2., 1.])
    """
    times = np.where(group >= 0, level[group], 1.0) if len(level) else np.ones(len(group))
    return Prior(np.sqrt(times) * prior.mean, times * prior.variance)


def at_levels(model: LinearModel, prior: Prior, group: Indices, logs: Logs) -> Posterior:
    """Posterior at given logarithms."""
    bands = len(model.count)
    return condition(model, scaled_prior(prior, group, np.exp(logs[bands:])), np.exp(logs[:bands]))


def slope_by_logs(posterior: Posterior, group: Indices, levels: int) -> Logs:
    """Slope (b + l,) of the log evidence by the logarithms."""
    gradient = posterior.gradient()
    of_columns = gradient.by_log_variance + 0.5 * posterior.score() * posterior.prior.mean
    has_level = group >= 0
    of_levels = np.bincount(group[has_level], of_columns[has_level], levels)
    return np.concatenate([gradient.by_log_noise, of_levels])


def fit_levels(model: LinearModel, prior: Prior, group: Indices, of_levels: LevelPrior, start: Logs) -> Levels:
    """Likeliest noise variances and levels from a start (b + l,). group (p,): level of each coefficient, -1 for none.

    Forty coefficients of variance 4 that are read directly, with noise of known variance 1: the mean square of the
    readings is 5.

    >>> from analysis.inference.linear_model import linear_model
    >>> y = np.sqrt(5.0) * np.resize([1.0, -1.0], 40)
    >>> wide, bounds = np.full(2, np.inf), np.array([0.0, 9.0])
    >>> of_levels = LevelPrior(np.zeros(2), wide, np.array([0.0, -9.0]), bounds)
    >>> model, prior = linear_model(np.eye(40), y), Prior(np.zeros(40), np.ones(40))
    >>> fit_levels(model, prior, np.zeros(40, dtype=np.int64), of_levels, np.zeros(2)).level.round(3)
    array([4.])
    """
    from scipy.optimize import minimize  # noqa: PLC0415 - slow to import

    levels = len(start) - len(model.count)

    def cost(logs: Logs) -> tuple[float, Logs]:
        posterior, away = at_levels(model, prior, group, logs), (logs - of_levels.median) / of_levels.width
        slope = slope_by_logs(posterior, group, levels) - away / of_levels.width
        return 0.5 * float(away @ away) - posterior.log_evidence, -slope

    bounds = list(zip(of_levels.low, of_levels.high, strict=True))
    optimum = minimize(cost, start, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxfun": _MOST_STEPS})
    logs = np.asarray(optimum.x, dtype=np.float64)
    return Levels(logs, at_levels(model, prior, group, logs))


def covariance_of_logs(
    model: LinearModel, prior: Prior, group: Indices, of_levels: LevelPrior, logs: Logs, free: Indices
) -> Matrix:
    """Covariance (f, f) of the logarithms `free` at their likeliest values, by Laplace's approximation.

    No direction is wider than the widest prior. Twice the logarithm of the standard deviation of n readings has the
    variance 2 / n:

    >>> from analysis.inference.linear_model import linear_model
    >>> nothing = model, prior = linear_model(np.zeros((50, 1)), np.resize([1.0, -1.0], 50)), Prior(*np.zeros((2, 1)))
    >>> wide = LevelPrior(np.zeros(1), np.full(1, np.inf), np.full(1, -9.0), np.full(1, 9.0))
    >>> covariance_of_logs(*nothing, np.array([-1]), wide, np.zeros(1), np.array([0])).round(4)
    array([[0.04]])
    """
    levels = len(logs) - len(model.count)

    def slope(at: Logs) -> Logs:
        away = (at - of_levels.median) / of_levels.width**2
        return away - slope_by_logs(at_levels(model, prior, group, at), group, levels)

    steps = _STEP * np.eye(len(logs))[free]
    curvature = np.stack([(slope(logs + step) - slope(logs - step))[free] for step in steps]) / (2 * _STEP)
    values, axes = np.linalg.eigh((curvature + curvature.T) / 2)
    return np.asarray((axes / np.maximum(values, of_levels.width[free].max() ** -2)) @ axes.T)


def noise_of_residual(posterior: Posterior, least_freedom: float = 0.25) -> ByBand:
    """Noise variances that the residual shows: energy over degrees of freedom, a fixed point of the evidence (MacKay
    1992), because the coefficients take some of the degrees of freedom.

    least_freedom: share of the readings of a band that count at least, where the coefficients could fit nearly all.

    >>> from analysis.inference.linear_model import linear_model
    >>> model = linear_model(np.ones((3, 1)), np.array([1.0, 2.0, 3.0]))
    >>> noise_of_residual(condition(model, Prior(np.zeros(1), np.full(1, 1e9)))).round(6)
    array([1.])
    """
    freedom = np.maximum(posterior.freedom(), least_freedom * posterior.model.count)
    energy = np.bincount(posterior.model.band, posterior.residual() ** 2, len(posterior.noise))
    return np.asarray(energy / freedom)
