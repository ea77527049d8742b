"""What makes joint angles a solution of a pose, and which solutions are the same."""

from __future__ import annotations

import numpy as np

from analysis.kinematics.arm import Arm, Array, Mask, tool_columns
from analysis.kinematics.turns import wrapped

_TOLERANCE_MM, _TOLERANCE_RAD = 1e-8, 1e-10
_SAME_RAD = 1e-6
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


def distinct(arm: Arm, q: Array, found: Mask) -> tuple[Array, Mask]:
    """q (n, k, 6) rad and found (n, k) without the solutions that an earlier slot has already; empty slots are nan."""
    found = found.copy()
    turned = q @ arm.coupling.T
    for slot in range(1, q.shape[1]):
        apart = np.abs(wrapped(turned[:, :slot] - turned[:, slot, None])).max(axis=2)
        found[:, slot] &= ~((apart < _SAME_RAD) & found[:, :slot]).any(axis=1)
    return np.where(found[..., None], q, np.nan), found


def may_hold_twins(turned: Array, found: Mask) -> Mask:
    """Which poses (n,) may have a solution twice among coupling @ q (k, 6, n), as far as one number of each says: a sum
    of absolute angles, which has no jump at half a turn."""
    number = np.einsum("i,kin->kn", _WEIGHTS, np.abs(turned))
    number = np.sort(np.where(found, number, np.inf), axis=0)
    with np.errstate(invalid="ignore"):  # inf - inf, where two are missing
        twins: Mask = (np.diff(number, axis=0) <= 2 * _SAME_RAD * _WEIGHTS.sum()).any(axis=0)
    return twins
