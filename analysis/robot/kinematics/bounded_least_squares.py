"""Least squares within bounds. That of scipy takes 0.1 to 0.15 s to import, 2 % of a diagnosis of circles."""

from __future__ import annotations

import numpy as np

from analysis.robot.kinematics.arm import Array, Mask


def bounded_least_squares(A: Array, values: Array, low: Array, high: Array) -> tuple[Array, Mask]:
    """Return the unknowns (q,) within bounds that minimise |A x - values|, and the mask of those at a bound.

    Active set of Stark and Parker (1995): release the bound with the largest slope, then fit the free unknowns.
    """
    x = np.clip(np.zeros(A.shape[1]), low, high)
    free = (x > low) & (x < high)
    x = _step_within(A, values, (low, high), x, free)
    # A smaller slope counts as zero. Chosen: a few hundred roundings.
    rounding = 1e-13 * np.linalg.norm(A, axis=0) * np.linalg.norm(values)
    for _ in range(3 * len(x)):  # as in Lawson and Hanson's program (1974)
        slope = A.T @ (values - A @ x)
        inwards = np.where(free, 0.0, np.where(x <= low, slope, -slope)) - rounding
        released = int(np.argmax(inwards))
        if inwards[released] <= 0:
            break
        free[released] = True
        x = _step_within(A, values, (low, high), x, free)
    return x, ~free


def _step_within(A: Array, values: Array, bounds: tuple[Array, Array], x: Array, free: Mask) -> Array:
    """Return the optimum (q,) of the free unknowns, and clear the mask of each that reaches a bound on the way."""
    low, high = bounds
    while free.any():
        best = x.copy()
        best[free] = np.linalg.lstsq(A[:, free], values - A[:, ~free] @ x[~free], rcond=None)[0]
        passed = np.flatnonzero((best < low) | (best > high))
        if not len(passed):
            return best
        bound = np.where(best < low, low, high)
        shares = ((bound - x)[passed]) / (best - x)[passed]
        first = passed[np.argmin(shares)]
        x = x + shares.min() * (best - x)
        x[first], free[first] = bound[first], False
    return x
