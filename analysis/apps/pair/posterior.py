"""Posterior of all unknowns of a pair, averaged over the uncertain levels of the groups."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize

from analysis.apps.pair.linear_gap import LinearGaps
from analysis.robot.kinematics.arm import Array

LEVELS = 6
"""Levels of the groups: constants, gravity and curves of the first arm, then of the second."""
_MEDIAN = np.log(np.array([1.0] * 6 + [0.03, 0.03, 0.05]))
"""Prior medians: usual sizes of the effects; unexplained part in mm (calibrated arms have 0.03 to 0.5 mm, and less with
curves of six orders); scatter of a seated ball in mm.
"""
_WIDTH = np.array([0.7] * 6 + [1.0, 1.0, 1.0])
"""Prior standard deviations of the logarithms: arms of one build differ by a factor of two, the others by three."""
_BOUND = 4.0
_WIDE_MM, _WIDE_RAD = 30.0, 0.03
"""Prior standard deviations of the set-up, without influence."""
_DRAWS, _SEED = 24, 20261127
_STEP = 1e-3


@dataclass(frozen=True)
class Levels:
    """Logarithms (9,) with their covariance."""

    log: Array
    cov: Array

    @property
    def scatter_mm(self) -> float:
        """Standard deviation of a coordinate of a seated ball."""
        return float(np.exp(self.log[8]))

    @property
    def unexplained_mm(self) -> tuple[float, float]:
        """Standard deviation of a coordinate, by arm."""
        return float(np.exp(self.log[6])), float(np.exp(self.log[7]))


@dataclass(frozen=True)
class PairPosterior:
    """Terms relative to the prior, the set-up relative to the linearisation."""

    mean: Array
    cov: Array
    prior_sd: Array
    """Prior standard deviations (k,) at the fitted levels."""
    levels: Levels
    odd: Array
    """Chi-square (touches,) of each touch given all others."""
    left_mm: Array
    """Each coordinate (3 touches,) of a gap minus its prediction from the other touches."""


@dataclass(frozen=True)
class _Solved:
    gain: Array
    setup_cov: Array
    without_setup: Array
    """Inverse covariance (m, m) of the readings with the set-up projected out."""
    log_determinants: float


@dataclass(frozen=True)
class _Evidence:
    """Negative log evidence by the levels.

    by_level (9, m, m): covariance of the readings for each level at 1. setup (m, s): derivatives by the set-up.
    """

    gaps: LinearGaps
    by_level: tuple[Array, ...]
    setup: Array

    def solved(self, log: Array) -> _Solved:
        cov = np.diag(self.gaps.known_var)
        for value, matrix in zip(log.tolist(), self.by_level, strict=True):
            cov = cov + np.exp(2 * value) * matrix
        factor = cho_factor(cov, lower=True, check_finite=False)
        inverse = cho_solve(factor, np.eye(len(cov)), check_finite=False)
        projected = inverse @ self.setup
        information = self.setup.T @ projected + np.diag(setup_sds(self.gaps) ** -2)
        setup_cov = np.asarray(np.linalg.inv(information), dtype=float)
        gain = np.asarray(setup_cov @ projected.T, dtype=float)
        determinants = float(np.log(np.diag(factor[0])).sum() + 0.5 * np.linalg.slogdet(information)[1])
        return _Solved(gain, setup_cov, inverse - projected @ gain, determinants)

    def value_and_slope(self, log: Array) -> tuple[float, Array]:
        """Value with the prior of the levels, and gradient (9,)."""
        solved = self.solved(log)
        weighted = solved.without_setup @ self.gaps.y
        away = (log - _MEDIAN) / _WIDTH
        value = solved.log_determinants + 0.5 * float(weighted @ self.gaps.y + away @ away)
        slope = np.array([
            np.exp(2 * log[k]) * ((solved.without_setup * matrix).sum() - weighted @ matrix @ weighted)
            for k, matrix in enumerate(self.by_level)
        ])  # fmt: skip
        return value, slope + away / _WIDTH


def _evidence_of(gaps: LinearGaps) -> _Evidence:
    columns = [gaps.columns[:, gaps.group == number] for number in range(LEVELS)]
    scatter = np.diag((gaps.known_var == 0).astype(float))
    return _Evidence(
        gaps, (*(group @ group.T for group in columns), *gaps.near, scatter), gaps.columns[:, gaps.group < 0]
    )


def setup_sds(gaps: LinearGaps) -> Array:
    """Prior standard deviations (s,) of the set-up in mm and rad."""
    sds = np.full(int((gaps.group < 0).sum()), _WIDE_MM)
    sds[3:6] = _WIDE_RAD
    return sds


def fitted_levels(gaps: LinearGaps, start: Array | None = None) -> Levels:
    """Most likely levels from a start (9,), with covariance by Laplace's approximation."""
    evidence = _evidence_of(gaps)
    bounds = list(zip(_MEDIAN - _BOUND * _WIDTH, _MEDIAN + _BOUND * _WIDTH, strict=True))
    optimum = minimize(
        evidence.value_and_slope, _MEDIAN if start is None else start, jac=True, method="L-BFGS-B", bounds=bounds,
        options={"maxiter": 60, "ftol": 1e-7},
    )  # fmt: skip
    log = np.asarray(optimum.x, dtype=float)
    steps = _STEP * np.eye(len(log))
    hessian = np.stack(
        [(evidence.value_and_slope(log + s)[1] - evidence.value_and_slope(log - s)[1]) / (2 * _STEP) for s in steps]
    )
    values, vectors = np.linalg.eigh((hessian + hessian.T) / 2)
    # No direction is wider than the prior.
    return Levels(log, (vectors / np.maximum(values, 1 / _WIDTH.max() ** 2)) @ vectors.T)


def posterior(gaps: LinearGaps, levels: Levels) -> PairPosterior:
    """Posterior averaged over the levels."""
    evidence = _evidence_of(gaps)
    rng = np.random.default_rng(_SEED)
    root = np.linalg.cholesky(levels.cov)
    half = root @ rng.standard_normal((len(levels.log), _DRAWS // 2))
    draws = levels.log + np.concatenate([half, -half], axis=1).T  # antithetic draws: their mean is exact
    low, high = _MEDIAN - _BOUND * _WIDTH, _MEDIAN + _BOUND * _WIDTH
    moments = [_moments(evidence, np.clip(log, low, high)) for log in draws]
    means = np.stack([mean for mean, _ in moments])
    off = means - means.mean(axis=0)
    mixed = np.mean([cov for _, cov in moments], axis=0) + off.T @ off / len(off)
    odd, left_mm = _left_out(gaps, evidence.solved(levels.log).without_setup)
    return PairPosterior(means.mean(axis=0), mixed, _prior_sds(gaps, levels.log), levels, odd, left_mm)


def expected_posterior(gaps: LinearGaps) -> PairPosterior:
    """Posterior of planned readings, at the prior medians of the levels."""
    levels = Levels(_MEDIAN, np.zeros((len(_MEDIAN),) * 2))
    _, cov = _moments(_evidence_of(gaps), levels.log)
    nothing = np.zeros(gaps.touches)
    return PairPosterior(
        np.zeros(len(cov)), cov, _prior_sds(gaps, _MEDIAN), levels, nothing, np.zeros(3 * gaps.touches)
    )


def _prior_sds(gaps: LinearGaps, log: Array) -> Array:
    sds = np.empty(len(gaps.group))
    terms = gaps.group >= 0
    sds[terms] = np.exp(log[gaps.group[terms]])
    sds[~terms] = setup_sds(gaps)
    return sds


def _moments(evidence: _Evidence, log: Array) -> tuple[Array, Array]:
    gaps, solved = evidence.gaps, evidence.solved(log)
    terms = gaps.group >= 0
    prior_sd = _prior_sds(gaps, log)[terms]
    columns = gaps.columns[:, terms] * prior_sd
    mean, cov = np.empty(len(terms)), np.empty((len(terms),) * 2)
    mean[terms] = prior_sd * (columns.T @ (solved.without_setup @ gaps.y))
    mean[~terms] = solved.gain @ gaps.y
    of_terms = np.eye(len(prior_sd)) - columns.T @ solved.without_setup @ columns
    across = -prior_sd[:, None] * (columns.T @ solved.gain.T)
    cov[np.ix_(terms, terms)] = np.outer(prior_sd, prior_sd) * of_terms
    cov[np.ix_(terms, ~terms)], cov[np.ix_(~terms, terms)] = across, across.T
    cov[np.ix_(~terms, ~terms)] = solved.setup_cov
    return mean, cov


def _left_out(gaps: LinearGaps, inverse: Array) -> tuple[Array, Array]:
    """Chi-square (touches,) of each touch given the others, and its gap minus the prediction."""
    weighted = inverse @ gaps.y
    count = gaps.touches
    odd, left_mm = np.empty(count), np.empty((count, 3))
    for touch, entries in enumerate(np.arange(3 * count).reshape(count, 3)):
        block = inverse[np.ix_(entries, entries)]
        left_mm[touch] = np.linalg.solve(block, weighted[entries])
        odd[touch] = left_mm[touch] @ block @ left_mm[touch]
    return odd, left_mm.ravel()
