"""Joint angles as solutions: what makes them one of a pose, which are the same modulo a turn, and in which turns the
arm can stand within its limits. An arm whose wrist winds on stands in one posture turns apart."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from analysis.robot.kinematics.arm import Arm, Array, Mask, tool_columns

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
        # Fewest and most turns (m,) that may bring row `axis` of coupling @ q from start (m,) within the limits.
        begins = start[rows, axis]
        ends = arm.coupling[axis][:, None] * arm.limits
        slack = _SLACK * np.abs(arm.coupling[axis]).sum()
        low, high = ends.min(axis=1).sum() - slack, ends.max(axis=1).sum() + slack
        fewest, most = np.ceil((low - begins) / (2 * np.pi)), np.floor((high - begins) / (2 * np.pi))
        count = np.maximum(most - fewest + 1, 0).astype(int)
        nth = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        rows, turns = np.repeat(rows, count), np.repeat(turns, count, axis=0)
        turns[:, axis] = np.repeat(fewest, count) + nth
    turned = q[rows] + turns @ turn.T
    inside = ((turned > arm.limits[:, 0] - _SLACK) & (turned < arm.limits[:, 1] + _SLACK)).all(axis=1)
    return turned[inside], rows[inside]


_MOST_RAD = 4 * np.pi + 0.1
"""An axis that cables pass through turns by no more than two turns each way. …"""
_WIND = 2
"""… Wrists wind on without an end: axis 6, and axis 4 of arms whose circle goes round it (UR e-series, wrist 3; ABB,
independent axis)."""


def wrapped(angle: Array) -> Array:
    """The same angles (n, …) rad in (-180°, 180°]."""
    wrapped: Array = angle - 2 * np.pi * np.ceil(angle / (2 * np.pi) - 0.5)
    return wrapped


def impossible_rad(q: Array) -> float:
    """The largest angle, rad, of joints q (n, axes) rad of which more have turned than wind on in any arm: such angles
    are of another unit. 0 where none have."""
    most = np.abs(q).max(axis=0, initial=0.0)
    return float(most.max(initial=0.0)) if np.count_nonzero(most > _MOST_RAD) > _WIND else 0.0


_TOLERANCE_MM, _TOLERANCE_RAD = 1e-8, 1e-10
SAME_RAD = 1e-6
"""Joint angles and turns that differ by less are meant to be the same, and rounded."""
_WEIGHTS = np.sqrt([2.0, 3.0, 5.0, 7.0, 11.0, 13.0])
"""Weights of the six angles in one number of a solution: no sum of few of them is that of others."""


def off_by(arm: Arm, poses: Array, q: Array) -> tuple[Array, Array]:
    """How far branches q (k, 6, n) are from their poses (n, 4, 4): mm (k, n), and rad (k, n) as the chord, which is the
    angle where it is small."""
    target = np.ascontiguousarray(poses.transpose(2, 1, 0)[:, :3])
    mm, rad = np.empty((2, len(q), len(poses)))
    for slot, angles in enumerate(q):
        off = tool_columns(arm, angles.T) - target
        off *= off
        off[3].sum(axis=0, out=mm[slot])
        off[:3].reshape(9, -1).sum(axis=0, out=rad[slot])
    return np.sqrt(mm), np.sqrt(rad / 2)


def good(mm: Array, rad: Array) -> Mask:
    """Which branches, so far off in mm (k, n) and rad (k, n), are solutions."""
    return (mm < _TOLERANCE_MM) & (rad < _TOLERANCE_RAD)


def distinct(arm: Arm, q: Array, solved: Mask) -> tuple[Array, Mask]:
    """q (n, k, 6) rad and solved (n, k) without the solutions that an earlier slot has already; empty slots are nan."""
    solved = solved.copy()
    turned = q @ arm.coupling.T
    for slot in range(1, q.shape[1]):
        apart = np.abs(wrapped(turned[:, :slot] - turned[:, slot, None])).max(axis=2)
        solved[:, slot] &= ~((apart < SAME_RAD) & solved[:, :slot]).any(axis=1)
    return np.where(solved[..., None], q, np.nan), solved


def may_hold_twins(turned: Array, solved: Mask) -> Mask:
    """Which poses (n,) may have a solution twice among coupling @ q (k, 6, n), as far as one number of each says: a sum
    of absolute angles, which has no jump at half a turn."""
    number = np.einsum("i,kin->kn", _WEIGHTS, np.abs(turned))
    number = np.sort(np.where(solved, number, np.inf), axis=0)
    with np.errstate(invalid="ignore"):  # inf - inf, where two are missing
        twins: Mask = (np.diff(number, axis=0) <= 2 * SAME_RAD * _WEIGHTS.sum()).any(axis=0)
    return twins
