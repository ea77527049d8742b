"""Inverse kinematics along a path: joint angles that follow a sequence of tool poses without a jump.

Strategy: walk a coarse subset of the poses one after the other, each solved by damped Newton from the
one before, so that the arm stays in the posture it began in; interpolate; then refine all poses at once
with the same Newton, vectorised. Works for any six-axis arm that the file describes.
"""

from __future__ import annotations

import numpy as np

from analysis.kinematics.arm import Arm, Array, forward_and_jacobian, pose_error
from rigs.errors import FileError

_TOLERANCE_MM = 1e-9
_ITERATIONS = 60
_KNOT_TURN = np.radians(4.0)
_LENGTH_MM = 500.0
"""Weighs rotations against translations in the damping and the step: the size of an arm."""


def follow(arm: Arm, poses: Array, posture: Array, where: str) -> Array:
    """Joint angles (n, 6) rad whose tool follows `poses` (n, 4, 4), starting nearest to `posture` (6,).

    `where` names the path in errors. Raises FileError where a pose cannot be reached or a joint would
    leave its limits.
    """
    knots = _knots(poses)
    walked = np.empty((len(knots), 6))
    q = posture
    for row, index in enumerate(knots.tolist()):
        solution, good = newton(arm, poses[index : index + 1], q[None])
        if not good[0]:
            raise FileError(
                where,
                f"pose {index + 1} of {len(poses)} at {_point(poses[index])} mm is out of reach from posture "
                f"{np.round(np.degrees(q), 1).tolist()}°",
                "move the centre, or set posture_deg near the start of the path",
            )
        q = walked[row] = solution[0]
    guess = np.stack([np.interp(np.arange(len(poses)), knots, column) for column in walked.T], axis=1)
    path, good = newton(arm, poses, guess)
    if not good.all() or np.abs(path - guess).max() > 10 * _KNOT_TURN:
        index = int(np.argmin(good)) if not good.all() else int(np.abs(path - guess).max(axis=1).argmax())
        raise FileError(
            where,
            f"the arm flips near pose {index + 1} of {len(poses)} at {_point(poses[index])} mm: a singularity",
            "move the circle or choose another posture_deg",
        )
    _hold_limits(arm, path, where)
    return path


def newton(arm: Arm, poses: Array, q: Array) -> tuple[Array, np.ndarray[tuple[int], np.dtype[np.bool_]]]:
    """Damped Newton from q (n, 6) towards poses (n, 4, 4): the angles and which of them converged."""
    scale = np.array([1.0, 1.0, 1.0, _LENGTH_MM, _LENGTH_MM, _LENGTH_MM])
    q = q.copy()
    for _ in range(_ITERATIONS):
        T, J = forward_and_jacobian(arm, q)
        error = pose_error(T, poses) * scale
        size = np.linalg.norm(error, axis=1)
        if (size < _TOLERANCE_MM).all():
            break
        J = J * scale[:, None]
        # Damping that fades with the error: safe far away, quadratic close by.
        damping = (1e-6 * size**2)[:, None, None] * np.eye(6)
        Jt = np.swapaxes(J, 1, 2)
        step = np.linalg.solve(Jt @ J + damping + 1e-12 * np.eye(6), (Jt @ error[:, :, None]))[:, :, 0]
        largest = np.abs(step).max(axis=1, keepdims=True)
        q += step * np.minimum(1.0, 0.5 / np.maximum(largest, 1e-300))
    return q, size < 1e3 * _TOLERANCE_MM


def _knots(poses: Array) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    """Indices at which tool turned or moved by a few degrees (of arm length) since the knot before."""
    if len(poses) == 1:
        return np.zeros(1, dtype=np.intp)
    motion = np.abs(pose_error(poses[:-1], poses[1:]) / ([_LENGTH_MM] * 3 + [1.0] * 3)).sum(axis=1)
    counts = np.floor(np.concatenate([[0.0], np.cumsum(motion)]) / _KNOT_TURN)
    inner = np.flatnonzero(np.diff(counts) > 0) + 1
    return np.unique(np.concatenate([[0], inner, [len(poses) - 1]])).astype(np.intp)


def _hold_limits(arm: Arm, path: Array, where: str) -> None:
    low, high = path.min(axis=0), path.max(axis=0)
    for axis in range(6):
        if low[axis] < arm.limits[axis, 0] or high[axis] > arm.limits[axis, 1]:
            raise FileError(
                where,
                f"axis {axis + 1} would move {np.degrees(low[axis]):.1f}° … {np.degrees(high[axis]):.1f}°, "
                f"its limits are {np.degrees(arm.limits[axis]).round(1).tolist()}°",
                "move the path or choose another posture_deg",
            )


def _point(pose: Array) -> list[float]:
    return [float(x) for x in np.round(pose[:3, 3], 1)]
