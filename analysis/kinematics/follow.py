"""Inverse kinematics along a path: joint angles that follow a sequence of tool poses without a jump.

Strategy: walk a coarse subset of the poses one after the other, each solved by damped Newton from the
one before, so that the arm stays in the posture it began in; interpolate; then refine all poses at once
with the same Newton, vectorised. Works for any six-axis arm that the file describes. Where Newton does
not reach the first pose from the posture, the walk begins at the branch nearest to the posture; where it
fails later, all branches of that pose show whether it is out of reach or behind a singularity.
"""

from __future__ import annotations

import numpy as np

from analysis.kinematics.arm import Arm, Array, pose_error
from analysis.kinematics.inverse import inverse
from analysis.kinematics.limits import within_limits
from analysis.kinematics.newton import LENGTH_MM, newton
from analysis.kinematics.singularity import cancelling_axes, conditioning
from rigs.errors import FileError

_KNOT_TURN = np.radians(4.0)


def follow(arm: Arm, poses: Array, posture: Array, where: str) -> Array:
    """Joint angles (n, 6) rad whose tool follows `poses` (n, 4, 4), starting nearest to `posture` (6,).

    `where` names the path in errors. Raises FileError where a pose cannot be reached, at a singularity
    that the arm cannot pass without a jump, or where a joint would leave its limits.
    """
    knots = _knots(poses)
    walked = _walk(arm, poses, knots, posture, where)
    guess = np.stack([np.interp(np.arange(len(poses)), knots, column) for column in walked.T], axis=1)
    path, good = newton(arm, poses, guess)
    jump = np.where(good, np.abs(path - guess).max(axis=1), np.inf)
    if jump.max() > 10 * _KNOT_TURN:
        index = int(jump.argmax())
        raise _flips(arm, poses, index, guess[index], where)
    _hold_limits(arm, path, where)
    return path


def _walk(arm: Arm, poses: Array, knots: np.ndarray[tuple[int], np.dtype[np.intp]], q: Array, where: str) -> Array:
    """Angles (k, 6) rad at the knots, each from the one before, the first from posture q (6,)."""
    walked = np.empty((len(knots), 6))
    for row, index in enumerate(knots.tolist()):
        pose = poses[index : index + 1]
        solution, good = newton(arm, pose, q[None])
        if good[0]:
            q = walked[row] = solution[0]
            continue
        branch = _nearest_branch(arm, pose, q)
        if branch is None:
            raise FileError(
                where,
                f"{_named(poses, index)} is out of reach of the arm in every posture",
                "move the centre",
            )
        if row > 0:
            raise _flips(arm, poses, index, q, where)
        q = walked[row] = branch
    return walked


def _nearest_branch(arm: Arm, pose: Array, q: Array) -> Array | None:
    """The angles (6,) rad, of all branches and turns for a pose (1, 4, 4), nearest to q (6,) rad and within the limits
    where any is."""
    solutions = inverse(arm, pose)
    found = solutions.q[solutions.found]
    allowed, _ = within_limits(arm, found)
    candidates = allowed if len(allowed) else found
    if not len(candidates):
        return None
    nearest: Array = candidates[np.abs(candidates - q).max(axis=1).argmin()]
    return nearest


def _flips(arm: Arm, poses: Array, index: int, q: Array, where: str) -> FileError:
    axes = " and ".join(str(axis) for axis in cancelling_axes(arm, q))
    return FileError(
        where,
        f"the arm changes its posture near {_named(poses, index)}: a singularity, where axes {axes} cancel each other "
        f"(conditioning {conditioning(arm, q[None])[0]:.1g} at {np.degrees(q).round(1).tolist()}°)",
        "move the circle or choose another posture_deg",
    )


def _knots(poses: Array) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    """Indices at which tool turned or moved by a few degrees (of arm length) since the knot before."""
    if len(poses) == 1:
        return np.zeros(1, dtype=np.intp)
    motion = np.abs(pose_error(poses[:-1], poses[1:]) / ([LENGTH_MM] * 3 + [1.0] * 3)).sum(axis=1)
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


def _named(poses: Array, index: int) -> str:
    point = [float(x) for x in np.round(poses[index][:3, 3], 1)]
    return f"pose {index + 1} of {len(poses)} at {point} mm"
