"""Posterior of all unknowns of a pair, averaged over the uncertain levels of the groups."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.apps.pair.linear_gap import LinearGaps
from analysis.inference.levels import LevelPrior, at_levels, covariance_of_logs, fit_levels
from analysis.inference.linear_model import LinearModel, Posterior, Prior, left_out, linear_model, zero_mean
from analysis.robot.kinematics.arm import Array, Integers

_MEDIAN = 2 * np.log(np.array([0.05] + [1.0] * 6 + [0.03, 0.03]))
"""Prior medians of the logarithms of the variances: scatter of a seated ball in mm; usual sizes of constants, gravity
and curves of the first arm, then of the second; unexplained part of each arm in mm (calibrated arms have 0.03 to 0.5
mm, and less with curves of six orders).
"""
_WIDTH = 2 * np.array([1.0] + [0.7] * 6 + [1.0, 1.0])
"""Prior standard deviations of these logarithms: arms of one build differ by a factor of two, the others by three."""
_BOUND = 4.0
_UNEXPLAINED = 6
"""Group of the unexplained part of the first arm; that of the second follows."""
_WIDE_MM, _WIDE_RAD = 30.0, 0.03
"""Prior standard deviations of the set-up, without influence."""
_DRAWS, _SEED = 24, 20261127
_NOTHING = 1e-12
"""Share of the largest variance below which a direction of the unexplained part is rounding."""


@dataclass(frozen=True)
class PairLevels:
    """Uncertain noise and levels of a pair."""

    logs: Array
    """Logarithms of variances: scatter, known distances, levels of the groups."""
    cov: Array
    """Covariance (9, 9) of the levels and, last, the scatter."""

    @property
    def scatter_mm(self) -> float:
        """Standard deviation of a coordinate of a seated ball."""
        return float(np.exp(self.logs[0] / 2))

    @property
    def unexplained_mm(self) -> tuple[float, float]:
        """Standard deviation of a coordinate, by arm."""
        return float(np.exp(self.logs[-2] / 2)), float(np.exp(self.logs[-1] / 2))


@dataclass(frozen=True)
class PairPosterior:
    """Terms relative to the prior, the set-up relative to the linearisation."""

    mean: Array
    cov: Array
    prior_sd: Array
    """Prior standard deviations (k,) at the fitted levels."""
    levels: PairLevels
    odd: Array
    """Chi-square (touches,) of each touch given all others."""
    left_mm: Array
    """Each coordinate (3 touches,) of a gap minus its prediction from the other touches."""


@dataclass(frozen=True)
class _GapModel:
    """Linear model of the gaps, with the unexplained part of each arm as additional columns."""

    gaps: LinearGaps
    linear: LinearModel
    prior: Prior
    group: Integers
    of_levels: LevelPrior

    @property
    def uncertain(self) -> Integers:
        """The levels and, last, the scatter: the noise of known distances is given."""
        return np.array([*range(len(self.linear.count), len(self.of_levels.median)), 0])

    def at(self, logs: Array) -> Posterior:
        return at_levels(self.linear, self.prior, self.group, logs)

    def moments(self, logs: Array) -> tuple[Array, Array]:
        """Mean (k,) and covariance (k, k) of the unknowns of the gaps."""
        at_logs, count = self.at(logs), len(self.gaps.group)
        return at_logs.mean[:count], at_logs.covariance_among(np.arange(count))

    def prior_sds(self, logs: Array) -> Array:
        return np.asarray(np.sqrt(self.at(logs).prior.variance[: len(self.gaps.group)]))


def _model_of(gaps: LinearGaps) -> _GapModel:
    known = gaps.known_var > 0
    band = np.where(known, np.cumsum(known), 0)  # each known distance has its own noise
    near = [_root(correlation) for correlation in gaps.near]
    parts = [np.full(columns.shape[1], _UNEXPLAINED + arm) for arm, columns in enumerate(near)]
    group, variance = np.concatenate([gaps.group, *parts]), np.ones(len(gaps.group) + sum(map(len, parts)))
    variance[group < 0] = setup_sds(gaps) ** 2
    given = np.log(gaps.known_var[known])
    median, away = (np.concatenate([a[:1], b, a[1:]]) for a, b in ((_MEDIAN, given), (_BOUND * _WIDTH, 0 * given)))
    width = np.concatenate([_WIDTH[:1], np.full(len(given), np.inf), _WIDTH[1:]])
    linear = linear_model(np.hstack([gaps.columns, *near]), gaps.y, band, by_readings=True)
    of_levels = LevelPrior(median, width, median - away, median + away)
    return _GapModel(gaps, linear, zero_mean(variance), group, of_levels)


def _root(correlation: Array) -> Array:
    """Columns (m, r) of independent unknowns with this correlation (m, m)."""
    values, axes = np.linalg.eigh(correlation)
    kept = values > _NOTHING * values.max()
    return np.asarray(axes[:, kept] * np.sqrt(values[kept]))


def setup_sds(gaps: LinearGaps) -> Array:
    """Prior standard deviations (s,) of the set-up in mm and rad."""
    sds = np.full(int((gaps.group < 0).sum()), _WIDE_MM)
    sds[3:6] = _WIDE_RAD
    return sds


def fitted_levels(gaps: LinearGaps, start: Array | None = None) -> PairLevels:
    """Most likely noise and levels from a start, with covariance by Laplace's approximation."""
    model = _model_of(gaps)
    given = model.linear, model.prior, model.group, model.of_levels
    logs = fit_levels(*given, model.of_levels.median if start is None else start).logs
    return PairLevels(logs, covariance_of_logs(*given, logs, model.uncertain))


def posterior(gaps: LinearGaps, levels: PairLevels) -> PairPosterior:
    """Posterior averaged over the levels."""
    model, count = _model_of(gaps), len(levels.cov)
    rng = np.random.default_rng(_SEED)
    half = np.linalg.cholesky(levels.cov) @ rng.standard_normal((count, _DRAWS // 2))
    draws = np.tile(levels.logs, (_DRAWS, 1))
    draws[:, model.uncertain] += np.concatenate([half, -half], axis=1).T  # antithetic draws: their mean is exact
    moments = [model.moments(logs) for logs in np.clip(draws, model.of_levels.low, model.of_levels.high)]
    means = np.stack([mean for mean, _ in moments])
    off = means - means.mean(axis=0)
    mixed = np.mean([cov for _, cov in moments], axis=0) + off.T @ off / len(off)
    at_levels = model.at(levels.logs)
    predicted = [left_out(at_levels, rows) for rows in np.arange(3 * gaps.touches).reshape(-1, 3)]
    odd = np.array([touch.chi_square for touch in predicted])
    left_mm = np.concatenate([touch.error for touch in predicted])
    return PairPosterior(means.mean(axis=0), mixed, model.prior_sds(levels.logs), levels, odd, left_mm)


def expected_posterior(gaps: LinearGaps) -> PairPosterior:
    """Posterior of planned readings, at the prior medians of the levels."""
    model = _model_of(gaps)
    logs = model.of_levels.median
    _, cov = model.moments(logs)
    nothing, certain = np.zeros(gaps.touches), np.zeros((len(model.uncertain),) * 2)
    levels = PairLevels(logs, certain)
    return PairPosterior(np.zeros(len(cov)), cov, model.prior_sds(logs), levels, nothing, np.zeros(3 * gaps.touches))
