"""Checks and variants of joint angles: accuracy of solutions, duplicates, and full turns within the joint limits.

Postures of an arm with an endless wrist may differ by full turns.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from analysis.robot.kinematics.arm import Arm, Array, Mask, tool_columns

_SLACK = 1e-9
"""Tolerance of a limit in rad, for rounding of a pose taught at the limit."""


def within_limits(arm: Arm, q: Array) -> tuple[Array, NDArray[np.intp]]:
    """All postures (k, 6) rad within the joint limits that differ from q (m, 6) by full turns, and their rows of q.

    Turns are those of theta, which a coupling may distribute to several joints, so all combinations are tried.
    """
    finite = np.flatnonzero(np.isfinite(q).all(axis=1))
    turn = 2 * np.pi * np.linalg.inv(arm.coupling)
    rows, turns = finite, np.zeros((len(finite), 6))
    start = q @ arm.coupling.T
    for axis in range(6):
        # Range of turns (m,) that may bring row `axis` of coupling @ q within the limits.
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


def turned_into(q: Array, ranges: Array, slack_rad: float = 0.0) -> Array:
    """Turn joint angles q (n, k) rad by full turns into the ranges (k, 2) rad, extended by `slack_rad` at both ends.

    The links are in the same place after a full turn. Angles that are inside, or in no turn inside, stay as they are.
    """
    low, high = ranges[:, 0] - slack_rad, ranges[:, 1] + slack_rad
    turned = q + 2 * np.pi * np.rint(((low + high) / 2 - q) / (2 * np.pi))
    gets_inside = ((q < low) | (q > high)) & (turned >= low) & (turned <= high)
    return np.where(gets_inside, turned, q)


_MOST_RAD = 4 * np.pi + 0.1
"""Limit of axes with internal cables: two turns in each direction."""
_WIND = 2
"""Largest number of endless axes: axis 6, and axis 4 if a circle is about it (UR e-series, wrist 3; ABB, independent
axis).
"""


def wrapped(angle: Array) -> Array:
    wrapped: Array = angle - 2 * np.pi * np.ceil(angle / (2 * np.pi) - 0.5)
    return wrapped


def impossible_rad(q: Array) -> float:
    """Largest impossible angle of joints q (n, axes) rad, or 0: more joints exceed the limit than an arm can have
    endless axes, probably because of their unit.
    """
    most = np.maximum(q.max(axis=0, initial=0.0), -q.min(axis=0, initial=0.0))
    return float(most.max(initial=0.0)) if np.count_nonzero(most > _MOST_RAD) > _WIND else 0.0


_TOLERANCE_MM, _TOLERANCE_RAD = 1e-8, 1e-10
SAME_RAD = 1e-6
"""Largest difference of equal joint angles or turns, due to rounding."""
_WEIGHTS = np.sqrt([2.0, 3.0, 5.0, 7.0, 11.0, 13.0])
"""Weights that combine six angles into a number identifying a solution."""


def off_by(arm: Arm, poses: Array, q: Array) -> tuple[Array, Array]:
    """Deviation of branches q (k, 6, n) from poses (n, 4, 4): in mm (k, n), and as a chord in rad (k, n)."""
    target = np.ascontiguousarray(poses.transpose(2, 1, 0)[:, :3])
    mm, rad = np.empty((2, len(q), len(poses)))
    for slot, angles in enumerate(q):
        off = tool_columns(arm, angles.T) - target
        off *= off
        off[3].sum(axis=0, out=mm[slot])
        off[:3].reshape(9, -1).sum(axis=0, out=rad[slot])
    return np.sqrt(mm), np.sqrt(rad / 2)


def good(mm: Array, rad: Array) -> Mask:
    return (mm < _TOLERANCE_MM) & (rad < _TOLERANCE_RAD)


def distinct(arm: Arm, q: Array, solved: Mask) -> tuple[Array, Mask]:
    """Remove duplicate solutions; empty slots become nan."""
    solved = solved.copy()
    turned = q @ arm.coupling.T
    for slot in range(1, q.shape[1]):
        apart = np.abs(wrapped(turned[:, :slot] - turned[:, slot, None])).max(axis=2)
        solved[:, slot] &= ~((apart < SAME_RAD) & solved[:, :slot]).any(axis=1)
    return np.where(solved[..., None], q, np.nan), solved


def may_have_duplicates(turned: Array, solved: Mask) -> Mask:
    """Mask (n,) of the poses that may have duplicate solutions in coupling @ q (k, 6, n) rad, by a weighted sum of
    absolute angles, which is continuous at half a turn.
    """
    number = np.einsum("i,kin->kn", _WEIGHTS, np.abs(turned))
    number = np.sort(np.where(solved, number, np.inf), axis=0)
    with np.errstate(invalid="ignore"):  # inf - inf, if two solutions are missing
        twins: Mask = (np.diff(number, axis=0) <= 2 * SAME_RAD * _WEIGHTS.sum()).any(axis=0)
    return twins
