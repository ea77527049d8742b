"""Inverse kinematics by Newton's method on the screws."""

from __future__ import annotations

import numpy as np

from tests.worlds.stranger.screws import Arm, Array, pose

_ROUNDS = 40
ARM_MM = 400.0
"""Lever arm in mm that makes rotations comparable with translations."""


class OutOfReachError(Exception):
    """The arm cannot reach a pose, or only with a jump."""


def solve(arm: Arm, R: Array, p: Array, q: Array) -> Array:
    """Return angles (n, 6) rad for tool frames R (n, 3, 3), p (n, 3), starting from q (n, 6). Raises
    OutOfReachError.
    """
    size = np.full(len(q), np.inf)
    for _ in range(_ROUNDS):
        at = pose(arm, q)
        miss = np.concatenate([p - at.p, ARM_MM * _turn(at.R, R)], axis=1)
        size = np.abs(miss).max(axis=1)
        if size.max() < 1e-9:
            break
        lever = np.cross(at.axis, at.p[:, None] - at.point)
        by_theta = np.concatenate([lever, ARM_MM * at.axis], axis=2)
        jacobian = np.einsum("nki,kj->nij", by_theta, arm.coupling)
        step = np.linalg.solve(jacobian + 1e-9 * np.eye(6), miss[:, :, None])[:, :, 0]
        q = q + step * np.minimum(1.0, 0.3 / np.maximum(np.abs(step).max(axis=1, keepdims=True), 1e-12))
    if not size.max() < 1e-6:
        raise OutOfReachError(f"{size.max():.3g} mm short")
    return q


def walk(arm: Arm, R: Array, p: Array, posture: Array, every: int) -> Array:
    """Return angles (n, 6) along a path of frames from a posture (6,): first every `every`-th frame in turn, then
    all together.
    """
    knots = [*range(0, len(p), every)]
    knots += [len(p) - 1] * (knots[-1] != len(p) - 1)
    found, q = [], posture[None]
    for k in knots:
        q = solve(arm, R[k : k + 1], p[k : k + 1], q)
        found.append(q[0])
    rows = np.arange(len(p))
    guess = np.stack([np.interp(rows, knots, column) for column in np.array(found).T], axis=1)
    path = solve(arm, R, p, guess)
    if np.abs(path - guess).max() > 0.3:
        raise OutOfReachError("the arm flips on the way")
    return path


def _turn(now: Array, wanted: Array) -> Array:
    """Rotation vector (n, 3) between two orientations, for small rotations."""
    skew = np.cross(now, wanted, axisa=1, axisb=1, axisc=1).sum(axis=2) / 2
    cosine = (np.einsum("nij,nij->n", now, wanted) - 1) / 2
    sine = np.linalg.norm(skew, axis=1)
    angle = np.arctan2(sine, cosine)
    return skew * np.where(sine > 1e-9, angle / np.maximum(sine, 1e-9), 1.0)[:, None]
