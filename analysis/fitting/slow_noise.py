"""A regression whose noise may be slow: how much each coefficient is worth where neighbouring readings err alike.

The noise is taken as white and slow together: the covariance of two readings is s² (white + r k(|t - t'| / tau)), k
falling exponentially (rough) or as Matérn's of order 3/2 (smooth). How much is slow (r), over which time (tau) and how
large all of it is (s) is not known. Each combination on a grid is weighed by its restricted likelihood, in which the
coefficients and s are integrated out, and the answer is the mean over all of them, each with Student's t. So a short
record, which cannot distinguish slow noise from the motion itself, has a large uncertainty.

Noise that a record cannot show at all could be of any size: its standard deviation has a half-Cauchy prior as wide as
what the regression leaves (Gelman, Bayesian Analysis 1, 2006), and smooth noise is at the slowest a quarter of the
record long.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.kinematics.arm import Array

_TIMES = 7
"""Correlation times from a step to the longest: neighbours differ by less than a factor of three at 100 steps."""
_LONGEST = (1.0, 0.25)
"""Longest times of rough and of smooth noise in lengths of the record. What is slower is a part of the motion to it."""
_SHARES = np.concatenate([[0.0], np.geomspace(1e-2, 1e6, 9)])
"""Slow variance over white variance; the mean of some hundred readings shows white noise hardly at all."""
_NONE = float(np.pi / np.log(_SHARES[2] / _SHARES[1]))
"""Weight of no slow noise: that of all shares together, which is the half-Cauchy's sum over the grid."""
_NOTHING = 1e-24
"""Square of a deviation, of readings without noise."""
_DRAWS = 4000
"""Draws of the coefficients; a quantile of 95 % is then good to 2 %."""


@dataclass(frozen=True)
class Regression:
    """value (p,) of the coefficients, in the readings' unit; covariance (p, p), in its square."""

    value: Array
    covariance: Array


@dataclass(frozen=True)
class _Case:
    """One combination of the grid: log of its weight; value (p,) of the coefficients; over s² their covariance (p, p);
    squares: the sum of squares of what is left, whitened."""

    log: float
    value: Array
    inverse: Array
    squares: float


def regress(design: Array, readings: Array, t_s: Array, count: Array) -> list[Regression]:
    """The coefficients of each column of readings (m, k), in any unit, by a design (m, p), as shares.

    t_s (m,): times; count (m,): how many equal readings each is the mean of. m must be 4 above p or more."""
    m, p = design.shape
    step = float(np.median(np.diff(t_s)))
    span = max(step * m, 2 * step)
    root = np.sqrt(count / count.mean())
    left = readings - design @ np.linalg.lstsq(design, readings, rcond=None)[0]
    usual = np.maximum((left**2).sum(axis=0) / (m - p), _NOTHING)
    cases: list[list[_Case]] = [[] for _ in readings.T]
    for longest, smooth in zip(_LONGEST, (0.0, 1.0), strict=True):
        for tau in np.geomspace(step, longest * span, _TIMES):
            away = np.abs(t_s[:, None] - t_s) / tau
            # Whitened by the white part, so that one decomposition serves every share.
            level, V = np.linalg.eigh((1 + smooth * away) * np.exp(-away) * np.outer(root, root))
            X, Y = (V.T @ (values * root[:, None]) for values in (design, readings))
            for share in _SHARES.tolist():
                variance = 1 + share * np.maximum(level, 0.0)
                for own, y, residual in zip(cases, Y.T, usual.tolist(), strict=True):
                    own.append(_case(X, y, variance, share, residual))
    return [_posterior(own, m - p) for own in cases]


def _case(X: Array, y: Array, variance: Array, share: float, usual: float) -> _Case:
    """One case by its restricted likelihood and the prior of its slow part; usual: mean square of what is left."""
    scaled = X / variance[:, None]
    information = scaled.T @ X
    inverse: Array = np.asarray(np.linalg.inv(information), dtype=np.float64)
    value = inverse @ (scaled.T @ y)
    free = len(y) - X.shape[1]
    squares = max(float(((y - X @ value) ** 2 / variance).sum()), _NOTHING)
    log = -0.5 * float(np.log(variance).sum() + np.linalg.slogdet(information)[1] + free * np.log(squares))
    slow = share * squares / free / usual
    # Half-Cauchy over the logarithm; no slow noise at all is as likely as some.
    return _Case(
        log + (float(np.log(np.sqrt(slow) / (1 + slow))) if share else float(np.log(_NONE))), value, inverse, squares
    )


def _posterior(cases: list[_Case], free: int) -> Regression:
    """The mean over all cases, and its covariance, scaled so that 1.96 u of each coefficient hold 95 % of the draws."""
    logs = np.array([case.log for case in cases])
    weight = np.exp(logs - logs.max())
    weight /= weight.sum()
    value: Array = weight @ np.array([case.value for case in cases])
    rng = np.random.default_rng(0)
    draws = []
    for case, count in zip(cases, rng.multinomial(_DRAWS, weight).tolist(), strict=True):
        size = np.sqrt(case.squares / rng.chisquare(free, count))[:, None]
        draws.append(
            case.value - value + size * (rng.normal(size=(count, len(value))) @ np.linalg.cholesky(case.inverse).T)
        )
    off = np.concatenate(draws)
    covariance = off.T @ off / _DRAWS
    wide = np.quantile(np.abs(off), 0.95, axis=0) / 1.96 / np.sqrt(np.diag(covariance))
    return Regression(value, covariance * np.outer(wide, wide))
