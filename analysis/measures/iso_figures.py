"""Figures of the standards, on stacks: ISO 9283:1998 clause 7.2, ISO 230-2:2014 clause 3."""

from __future__ import annotations

import numpy as np

from analysis.kinematics.arm import Array

RP_VISITS = 30
"""Cycles that ISO 9283 asks for."""
FEWEST_CYCLES = 3
"""Cycles that a standard deviation is taken of."""
RANGE_VISITS = 5
"""Approaches a side that ISO 230-2 asks for."""


def rp(x: Array) -> Array:
    """ISO 9283, 7.2.2, position repeatability (...,) mm of attained points x (..., n, d) mm, NaN where one is missing:
    mean + 3 S of their distances from their barycentre, S with n - 1."""
    away = np.linalg.norm(x - np.nanmean(x, axis=-2, keepdims=True), axis=-1)
    return np.asarray(np.nanmean(away, axis=-1) + 3.0 * np.nanstd(away, axis=-1, ddof=1))


def reversal(x: Array) -> dict[str, Array]:
    """ISO 230-2 figures (...,) of readings x (..., targets, 2, n), the sides ↓ (from outside) and ↑ (from inside),
    NaN where one is missing: R↓, R↑, R, largest B without sign, mean B = mean of x̄↑ - x̄↓."""
    mean, s = np.nanmean(x, axis=-1), np.nanstd(x, axis=-1, ddof=1)
    B = mean[..., 1] - mean[..., 0]
    both = 2 * s.sum(axis=-1) + np.abs(B)
    return {
        "r_out_mm": 4 * s[..., 0].max(axis=-1),
        "r_in_mm": 4 * s[..., 1].max(axis=-1),
        "r_mm": np.maximum(both, 4 * s.max(axis=-1)).max(axis=-1),
        "reversal_mm": np.abs(B).max(axis=-1),
        "reversal_mean_mm": B.mean(axis=-1),
    }
