"""Inverse kinematics along a path: joint angles that follow a sequence of tool poses continuously.

The first pose is solved by damped Newton from the given posture. If this fails, the branch closest to the posture is
used. An arm with a closed form, or close to one, keeps this branch for all poses, refined by Newton. If the branch is
discontinuous, or the arm is of no known kind, a coarse subset of the poses is solved one after the other by Newton, and
the poses in between are interpolated and refined. If this fails as well, the branches of the failed pose show whether
it is out of reach or behind a singularity.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from analysis.robot.kinematics.arm import Arm, Array, blocks, pose_error
from analysis.robot.kinematics.inverse import branches, canonical, inverse
from analysis.robot.kinematics.joint_limits import SAME_RAD, within_limits, wrapped
from analysis.robot.kinematics.newton import LENGTH_MM, REACHED_MM, cancelling_axes, conditioning, from_nearby, newton
from rigs.errors import PathError

Indices = NDArray[np.intp]

_KNOT_TURN = np.radians(4.0)
_JUMP = 10 * _KNOT_TURN
"""Largest deviation of a joint from linear interpolation between knots."""
_IN_METRES = 10.0
"""Largest coordinate of a centre in mm that may be meant in metres. Chosen: the longest arms reach 6 m."""


def follow(arm: Arm, poses: Array, posture: Array, where: str) -> Array:
    """Joint angles (n, 6) rad for which the tool follows `poses` (n, 4, 4), starting near `posture` (6,).

    Raises PathError if a pose is unreachable, if a singularity requires a jump, or if a joint limit is violated.
    """
    solution, good = newton(arm, poses[:1], posture[None])
    start = solution[0] if good[0] else _nearest_branch(arm, poses[:1], posture)
    if start is None:
        raise _out_of_reach(poses, 0, where)
    knots = _knots(poses)
    path = _on_one_branch(arm, poses, knots, start)
    if path is None:
        path = _walked(arm, poses, knots, start, where)
    low, high = path.min(axis=0), path.max(axis=0)
    for axis in range(6):
        if low[axis] < arm.limits[axis, 0] or high[axis] > arm.limits[axis, 1]:
            raise PathError(
                where,
                f"axis {axis + 1} would move from {np.degrees(low[axis]):.1f}° to {np.degrees(high[axis]):.1f}°, "
                f"beyond the limits {np.degrees(arm.limits[axis]).round(1).tolist()}°",
                "move the path or choose another posture_deg",
                "limits",
            )
    return path


def _knots(poses: Array) -> Indices:
    """Indices between which the tool moved by a few degrees, or by the corresponding arc at arm length.

    The function releases the temporary memory, twice that of the poses (n, 4, 4), before the path is computed.
    """
    steps = [pose_error(poses[:-1][block], poses[1:][block]) for block in blocks(len(poses) - 1)]
    motion = np.abs(np.concatenate([np.zeros((1, 6)), *steps]) / ([LENGTH_MM] * 3 + [1.0] * 3)).sum(axis=1)
    counts = np.floor(np.cumsum(motion) / _KNOT_TURN)
    return np.unique([0, *(np.flatnonzero(np.diff(counts) > 0) + 1), len(poses) - 1]).astype(np.intp)


def _on_one_branch(arm: Arm, poses: Array, knots: Indices, start: Array) -> Array | None:
    """Closed-form branch (n, 6) rad near start (6,), refined for the true arm; None if there is none or it is
    discontinuous.
    """
    form = canonical(arm)
    if form is None:
        return None
    theta = arm.coupling @ start + arm.offset
    slot = int(np.abs(wrapped(branches(form, poses[:1])[:, :, 0] - theta)).max(axis=1).argmin())
    path = np.concatenate([branches(form, poses[block], slot=slot)[0].T for block in blocks(len(poses))])
    path = np.unwrap(path, axis=0)
    path += 2 * np.pi * np.rint((theta - path[0]) / (2 * np.pi))
    path, off_mm, _ = from_nearby(arm, poses, (path - arm.offset) @ np.linalg.inv(arm.coupling).T)
    if not (off_mm < REACHED_MM).all() or np.abs(path[0] - start).max() > SAME_RAD:
        return None
    # If the motion between knots is below the threshold, so is the deviation from linear interpolation.
    swing = np.maximum.reduceat(path, knots) - np.minimum.reduceat(path, knots)
    step = np.abs(np.diff(path, axis=0)).max(initial=0.0)
    return path if max(swing.max(), step) < _JUMP else None


def _walked(arm: Arm, poses: Array, knots: Indices, start: Array, where: str) -> Array:
    """Solve the knots one after the other by Newton, then the poses in between: (n, 6) rad."""
    walked = np.empty((len(knots), 6))
    q = walked[0] = start
    for row, knot in enumerate(knots[1:].tolist(), start=1):
        pose = poses[knot : knot + 1]
        solution, good = newton(arm, pose, q[None])
        if not good[0]:
            reachable = _nearest_branch(arm, pose, q) is not None
            raise _flips(arm, poses, knot, q, where) if reachable else _out_of_reach(poses, knot, where)
        q = walked[row] = solution[0]
    guess = np.stack([np.interp(np.arange(len(poses)), knots, column) for column in walked.T], axis=1)
    path, good = newton(arm, poses, guess)
    jump = np.where(good, np.abs(path - guess).max(axis=1), np.inf)
    if jump.max() > _JUMP:
        index = int(jump.argmax())
        raise _flips(arm, poses, index, guess[index], where)
    return path


def _nearest_branch(arm: Arm, pose: Array, q: Array) -> Array | None:
    """Angles (6,) rad closest to q among all branches and turns; those within the limits are preferred."""
    solutions = inverse(arm, pose)
    postures = solutions.q[solutions.found]
    allowed, _ = within_limits(arm, postures)
    candidates = allowed if len(allowed) else postures
    if not len(candidates):
        return None
    nearest: Array = candidates[np.abs(candidates - q).max(axis=1).argmin()]
    return nearest


def _out_of_reach(poses: Array, index: int, where: str) -> PathError:
    what = f"{_pose_name(poses, index)} is out of reach of the arm in every posture"
    centre = poses[:, :3, 3].mean(axis=0)
    in_metres = "; if centre_mm is in metres, multiply it by 1000" * bool(np.abs(centre).max() < _IN_METRES)
    return PathError(where, what, f"move the centre{in_metres}", "reach")


def _flips(arm: Arm, poses: Array, index: int, q: Array, where: str) -> PathError:
    axes = " and ".join(str(axis) for axis in cancelling_axes(arm, q))
    return PathError(
        where,
        f"the arm changes its posture near {_pose_name(poses, index)}: "
        f"a singularity, where axes {axes} cancel each other "
        f"(conditioning {conditioning(arm, q[None])[0]:.1g} at {np.degrees(q).round(1).tolist()}°)",
        "move the circle or choose another posture_deg",
        "singularity",
    )


def _pose_name(poses: Array, index: int) -> str:
    point = [float(x) for x in np.round(poses[index][:3, 3], 1)]
    return f"pose {index + 1} of {len(poses)} at {point} mm"
