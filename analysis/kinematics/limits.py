"""Joint limits: which turns of a solution the arm can stand in."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from analysis.kinematics.arm import Arm, Array

_SLACK = 1e-9
"""rad by which a limit may be passed: the rounding of a pose that was taught on it."""


def within_limits(arm: Arm, q: Array) -> tuple[Array, NDArray[np.intp]]:
    """Every posture within the joint limits that differs from q (m, 6) rad by whole turns of its axes.

    Returns them (k, 6) rad, and for each the row of q it comes from (k,). A whole turn is one of theta, so
    a coupling may carry it to several joints of the controller: all combinations are tried, whatever the
    coupling is. Rows of q that are not finite have none.
    """
    finite = np.flatnonzero(np.isfinite(q).all(axis=1))
    turn = 2 * np.pi * np.linalg.inv(arm.coupling)
    rows, turns = finite, np.zeros((len(finite), 6))
    start = q @ arm.coupling.T
    for axis in range(6):
        fewest, most = _turns(arm, axis, start[rows, axis])
        count = np.maximum(most - fewest + 1, 0).astype(int)
        nth = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        rows, turns = np.repeat(rows, count), np.repeat(turns, count, axis=0)
        turns[:, axis] = np.repeat(fewest, count) + nth
    turned = q[rows] + turns @ turn.T
    inside = ((turned > arm.limits[:, 0] - _SLACK) & (turned < arm.limits[:, 1] + _SLACK)).all(axis=1)
    return turned[inside], rows[inside]


def _turns(arm: Arm, axis: int, start: Array) -> tuple[Array, Array]:
    """Fewest and most turns (m,) that may bring row `axis` of coupling @ q from start (m,) within the limits."""
    ends = arm.coupling[axis][:, None] * arm.limits
    slack = _SLACK * np.abs(arm.coupling[axis]).sum()
    low, high = ends.min(axis=1).sum() - slack, ends.max(axis=1).sum() + slack
    return np.ceil((low - start) / (2 * np.pi)), np.floor((high - start) / (2 * np.pi))
