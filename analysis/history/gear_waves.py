"""What waves of gears make of a lap, beside what plays make: near a reversal, one can look like the other.

A gear is out by a wave of the joint's angle, and a joint that turns back runs through the same wave twice, so that the
lap has no jump there but a bend. Fitted by plays alone, a gear of axis 4 with order 8 was a play of axis 5 of -0.30° ±
0.03°. So waves of all axes and of the usual orders are fitted with the plays, each with a size of its own that the lap
determines (automatic relevance, MacKay 1992): what the lap does not show costs nothing, what it cannot distinguish from
a play is in the play's uncertainty.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from analysis.kinematics.arm import Array

ORDERS = (1, 2, 3, 4, 5, 6, 8, 10, 12)
"""Cycles a turn of a joint: eccentric wheels, wave generators and their stages; what is faster is seldom as large, and
shorter than the neighbourhood that a jump is judged by."""
_SIZE_DEG = 0.005
"""What a wave is taken to have at the beginning: usual gears have some thousandths of a degree."""
_LEAST_DEG = 1e-6
_ROUNDS = 40


@dataclass(frozen=True)
class Fitted:
    """sizes (p,) of the plays in degrees, their part of the solution (p, m) by the readings (m,), the variance of a
    reading, and the misfit: minus twice the log of the evidence, of which the least is the best."""

    sizes_deg: Array
    solve: Array
    u_deg: Array
    misfit: float


def waves_of(slopes: Array, q: Array) -> Array:
    """What waves of one degree make of a lap: (m, 2 pairs) in mm, a sine and a cosine beside one another.

    slopes (m, 6) mm for each degree by which a joint is out; q (m, 6) rad, the joints at the same readings.
    """
    turns = q[:, :, None] * np.array(ORDERS)
    both = np.stack([np.sin(turns), np.cos(turns)], axis=3) * slopes[:, :, None, None]
    waves: Array = both.reshape(len(q), -1)
    return waves


def fitted(
    lap: Array,
    curve: Callable[[Array], Array],
    slopes: Callable[[Array], Array],
    waves: Array,
    start_deg: Array,
    widest_deg: float,
    alike: float,
) -> Fitted:
    """Plays and waves that fit a lap (m,) mm, from plays of start_deg (p,).

    curve, slopes: what plays (p,) in degrees make of the lap, (m,) mm, and its derivatives (m, p); waves (m, k) mm for
    each degree; alike: of how many readings one is by itself.
    """
    sizes, plays = start_deg.copy(), len(start_deg)
    variances = np.full(waves.shape[1] // 2, _SIZE_DEG**2)
    noise = max(float(lap.var()), 1e-18) * alike
    squares = waves.T @ waves
    for _ in range(_ROUNDS):
        by_play = slopes(sizes)
        target = lap - curve(sizes) + by_play @ sizes
        cross = by_play.T @ waves
        information = np.block([[by_play.T @ by_play, cross], [cross.T, squares]]) / noise
        prior = np.concatenate([np.full(plays, 1e-9), 1 / np.repeat(variances, 2)])
        covariance = np.linalg.inv(information + np.diag(prior))
        columns = np.concatenate([by_play, waves], axis=1)
        solution = covariance @ (columns.T @ target) / noise
        step = np.clip(solution[:plays] - sizes, -0.05, 0.05)
        sizes = np.clip(sizes + step, -widest_deg, widest_deg)
        residuals_mm = lap - curve(sizes) - waves @ solution[plays:]
        of_waves = solution[plays:] ** 2 + np.diag(covariance)[plays:]
        determined = len(solution) - float(prior @ np.diag(covariance))
        noise = max(float(residuals_mm @ residuals_mm) * alike / max(len(lap) / alike - determined, 1.0) / alike, 1e-18)
        variances = np.maximum(of_waves.reshape(-1, 2).mean(axis=1), _LEAST_DEG**2)
    solve = (covariance @ columns.T / noise)[:plays]
    penalty = float((solution[plays:] ** 2 / np.repeat(variances, 2)).sum() + np.log(np.repeat(variances, 2)).sum())
    evidence = len(lap) / alike * np.log(noise) + float(residuals_mm @ residuals_mm) / noise + penalty
    misfit = float(evidence - np.linalg.slogdet(covariance)[1])
    return Fitted(sizes, solve, np.sqrt(np.diag(covariance)[:plays]), misfit)
