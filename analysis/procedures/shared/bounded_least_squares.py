"""Least squares within bounds, for a few unknowns.

scipy has this too, but the import of `scipy.optimize` takes a third of a second, a twentieth of a diagnosis of circles.
"""

from __future__ import annotations

import numpy as np

from analysis.robot.kinematics.arm import Array, Mask

_ROUNDING = 1e-13
"""Slope at a bound, relative to the lengths of column and values, that counts as zero. Chosen: a few hundred roundings
of a double.
"""
_ROUNDS = 3
"""Largest number of released bounds per unknown, as in Lawson and Hanson's program (1974)."""


def bounded_least_squares(A: Array, values: Array, low: Array, high: Array) -> tuple[Array, Mask]:
    """Return the unknowns (q,) from `low` to `high` that minimise |A x - values|, and the mask of those at a bound.

    A (n, q) has independent columns. The algorithm is the active set of Stark and Parker (1995): release the bound with
    the largest slope, then step towards the optimum of the free unknowns until none of them passes a bound.
    """
    x = np.clip(np.zeros(A.shape[1]), low, high)
    free = (x > low) & (x < high)
    x = _step_within(A, values, (low, high), x, free)
    rounding = _ROUNDING * np.linalg.norm(A, axis=0) * np.linalg.norm(values)
    for _ in range(_ROUNDS * len(x)):
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
        bound = np.where(best < low, low, high)[passed]
        shares = (bound - x[passed]) / (best - x)[passed]
        first = int(np.argmin(shares))
        x = x + shares[first] * (best - x)
        x[passed[first]] = bound[first]
        free[passed[first]] = False
    return x
