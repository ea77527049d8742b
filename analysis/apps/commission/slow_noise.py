"""Regression with slow noise: the uncertainty of each coefficient if the errors of neighbouring readings correlate.

The covariance of two readings is s² (white + r k(|t - t'| / tau)). The kernel k decays exponentially (rough) or is a
Matérn kernel of order 3/2 (smooth). Each combination of r and tau on a grid is weighted by the restricted likelihood,
with the coefficients and s integrated out; the result is the mean over all, each with a Student t distribution. Noise
that a record cannot reveal could have any size, so its standard deviation has a half-Cauchy prior as wide as the
residual (Gelman, Bayesian Analysis 1, 2006), and smooth noise correlates over at most a quarter of the record.
"""

from __future__ import annotations

import numpy as np

from analysis.robot.kinematics.arm import Array

_TIMES = 7
"""Correlation times tried, from a step to the longest."""
_LONGEST = (1.0, 0.25)
"""Longest correlation times of rough and smooth noise, relative to the record. Slower noise looks like motion."""
_SHARES = np.concatenate([[0.0], np.geomspace(1e-2, 1e6, 9)])
"""Ratios of slow to white variance. White noise almost vanishes in the mean of some hundred readings."""
_NONE = float(np.pi / np.log(_SHARES[2] / _SHARES[1]))
"""Prior weight of no slow noise: the total weight of all other cases."""
_NOTHING = 1e-24
"""Squared deviation used for noise-free readings."""
_DRAWS = 4000
"""Draws of the coefficients: a 95 % quantile is then accurate to 2 %."""


def regress(design: Array, readings: Array, t_s: Array, count: Array) -> list[tuple[Array, Array]]:
    """Fit each column of readings (m, k) by the design (m, p): coefficients (p,) with covariance (p, p).

    t_s (m,): timestamps. count (m,): number of equal readings averaged in each row. m must be at least p + 4.
    """
    m, p = design.shape
    step = float(np.median(np.diff(t_s)))
    span = max(step * m, 2 * step)
    root = np.sqrt(count / count.mean())
    residual = readings - design @ np.linalg.lstsq(design, readings, rcond=None)[0]
    usual = np.maximum((residual**2).sum(axis=0) / (m - p), _NOTHING)
    cases = []
    for longest, smooth in zip(_LONGEST, (0.0, 1.0), strict=True):
        for tau in np.geomspace(step, longest * span, _TIMES):
            away = np.abs(t_s[:, None] - t_s) / tau
            # Whiten with the white part: a single decomposition then serves every share.
            level, V = np.linalg.eigh((1 + smooth * away) * np.exp(-away) * np.outer(root, root))
            X, Y = (V.T @ (values * root[:, None]) for values in (design, readings))
            for share in _SHARES.tolist():
                variance = 1 + share * np.maximum(level, 0.0)
                scaled = X / variance[:, None]
                information = scaled.T @ X
                inverse = np.linalg.inv(information)
                values = inverse @ (scaled.T @ Y)
                squares = np.maximum(((Y - X @ values) ** 2 / variance[:, None]).sum(axis=0), _NOTHING)
                log = np.log(variance).sum() + np.linalg.slogdet(information)[1] + (m - p) * np.log(squares)
                slow = share * squares / (m - p) / usual
                # Half-Cauchy prior of the logarithm. Zero slow noise is as likely as any slow noise.
                prior = np.sqrt(slow) / (1 + slow) if share else np.full(len(usual), _NONE)
                cases.append((np.log(prior) - log / 2, values.T, squares, inverse))
    logs, values, squares, inverses = (np.stack(part) for part in zip(*cases, strict=True))
    return [_posterior(logs[:, k], values[:, k], squares[:, k], inverses, m - p) for k in range(len(usual))]


def _posterior(logs: Array, values: Array, squares: Array, inverses: Array, free: int) -> tuple[Array, Array]:
    """Mean (p,) and covariance (p, p) over all cases, scaled so that ±1.96 u of each coefficient covers 95 %.

    logs (c,): log weights. squares (c,): whitened sums of squared residuals. inverses (c, p, p): covariances over s².
    """
    weight = np.exp(logs - logs.max())
    weight /= weight.sum()
    value: Array = weight @ values
    rng = np.random.default_rng(0)
    draws = []
    for number, count in enumerate(rng.multinomial(_DRAWS, weight).tolist()):
        size = np.sqrt(squares[number] / rng.chisquare(free, count))[:, None]
        noise = rng.normal(size=(count, len(value))) @ np.linalg.cholesky(inverses[number]).T
        draws.append(values[number] - value + size * noise)
    off = np.concatenate(draws)
    covariance = off.T @ off / _DRAWS
    wide = np.quantile(np.abs(off), 0.95, axis=0) / 1.96 / np.sqrt(np.diag(covariance))
    return value, covariance * np.outer(wide, wide)
