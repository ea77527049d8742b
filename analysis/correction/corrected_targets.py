"""Corrected targets: the commands with which the real arm reaches the positions that were commanded to the nominal arm.

The real arm is the model with the effects that can be corrected. The command is moved by the error of the real arm
until the error vanishes; effects are small, so each round leaves about a thousandth of it. The controller is assumed to
compute with the nominal arm, so a corrected pose is the pose of the nominal arm at the corrected angles.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.correction.left_out import left_out_mm
from analysis.correction.pose_uncertainty import PoseUncertainty, covered, pose_uncertainty, position_u_mm
from analysis.correction.support import Support
from analysis.correction.work import rest_effects, tool_poses, used_effects
from analysis.fitting.joint_coverage import outside_coverage
from analysis.kinematics.arm import Arm, Array, Mask, arm_of, forward, pose_error
from analysis.kinematics.inverse import inverse
from analysis.kinematics.limits import within_limits
from analysis.kinematics.newton import newton
from analysis.model.predict import model_of
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.effect import label_of

_ROUNDS = 20
"""Largest number of rounds. Chosen: each reduces the error about a thousandfold, so two or three are usual."""
_REACHED = 1e-6
"""Error in mm, with a radian counted as 1 m, at which a target is reached: 1 nm, below any resolution."""


@dataclass(frozen=True)
class Corrected:
    """The targets of a path with their corrections.

    `q` (n, 6) rad are the corrected angles and `T` (n, 4, 4) the poses of the nominal arm at them. `missed_mm` (n,) is
    the error that the corrected effects caused. `left_out_mm` (n, e) is the root mean square error of each effect that
    is not corrected, with the names left_out (e,). `u_mm` (n,) is the standard uncertainty of the position, from that
    of the model and from effects that are not corrected. `covered` (n,) is whether all joints stand where the runs
    drove them, None where that is unknown. `doubts` are in words.
    """

    q: Array
    T: Array
    missed_mm: Array
    left_out: tuple[str, ...]
    left_out_mm: Array
    u_mm: Array
    covered: Mask | None
    doubts: tuple[str, ...]


def corrected(rig: Rig, found: Sequence[Support], q: Array, lines: Sequence[int], where: str) -> Corrected:
    """Return targets, given as nominal angles q (n, 6) rad, corrected for the effects that can be corrected.

    `lines` (n,) are those of the targets in the file `where`, for messages. Raises FileError for a target beyond limits
    or at a singularity.
    """
    used, known = used_effects(rig, found), pose_uncertainty(rig, found)
    model = model_of(rig, used)
    _hold_limits(model.arm, q, lines, where)
    wanted = forward(model.arm, q)
    command, angles = wanted.copy(), q
    for _ in range(_ROUNDS):
        reached = tool_poses(model, angles)
        if (np.abs(pose_error(reached, wanted)) * [1, 1, 1, 1e3, 1e3, 1e3]).max() < _REACHED:
            break
        command = command @ np.linalg.inv(reached) @ wanted
        angles, good = newton(model.arm, command, angles)
        if not good.all():
            raise _singular(lines[int(np.argmin(good))], where)
    else:
        error = np.abs(pose_error(reached, wanted)).max(axis=1)
        raise _singular(lines[int(error.argmax())], where)
    _hold_limits(model.arm, angles, lines, where)
    rest = rest_effects(rig, found)
    left_out = left_out_mm(rig, rest, angles)
    return Corrected(
        angles,
        forward(model.arm, angles),
        _distance(tool_poses(model, q), wanted),
        tuple(map(label_of, rest)),
        left_out,
        np.hypot(position_u_mm(known, angles), np.linalg.norm(left_out, axis=1)),
        covered(known, angles),
        tuple(_doubts(known, angles)),
    )


def angles_for(rig: Rig, poses: Array, lines: Sequence[int], where: str) -> Array:
    """Return nominal angles (n, 6) rad of target poses (n, 4, 4): the first closest to the posture of the rig's tests,
    each other closest to the one before. Raises FileError for a pose out of reach or limits."""
    arm = arm_of(rig.robot)
    solutions = inverse(arm, poses)
    near = _posture(rig, arm)
    chosen = np.empty((len(poses), 6))
    for k, line in enumerate(lines):
        branches = solutions.q[k][solutions.found[k]]
        if not len(branches):
            raise FileError(f"{where}, line {line}", "is out of the nominal arm's reach", "move the target")
        allowed, _ = within_limits(arm, branches)
        if not len(allowed):
            raise FileError(f"{where}, line {line}", "can only be reached beyond a joint's limits", "move the target")
        near = chosen[k] = allowed[np.abs(allowed - near).max(axis=1).argmin()]
    return chosen


def _posture(rig: Rig, arm: Arm) -> Array:
    """Return the posture (6,) rad of the arm's work: that of its hemisphere or circle, or else the middle of its
    limits."""
    for test in (rig.tests.hemisphere, rig.tests.circle):
        if test:
            return np.radians(test.posture_deg)
    middle: Array = arm.limits.mean(axis=1)
    return middle


def _doubts(known: PoseUncertainty, q: Array) -> list[str]:
    """Return in words how many targets at angles q (n, 6) rad are not covered, and by which joints."""
    inside = covered(known, q)
    if inside is None or known.joints_rad is None or inside.all():
        return []
    counted = f"{int((~inside).sum())} of {len(q)} targets stand outside the joint angles of the runs"
    ranges = [(low, high) for low, high in np.degrees(known.joints_rad).tolist()]
    first = f"{counted}: they have no in the column covered, and u is not to be relied on there"
    return [first, *outside_coverage(ranges, q, "the model")]


def _distance(T: Array, other: Array) -> Array:
    distance: Array = np.linalg.norm(T[:, :3, 3] - other[:, :3, 3], axis=1)
    return distance


def _singular(line: int, where: str) -> FileError:
    return FileError(f"{where}, line {line}", "cannot be corrected: the arm is at a singularity", "move the target")


def _hold_limits(arm: Arm, q: Array, lines: Sequence[int], where: str) -> None:
    outside = (q < arm.limits[:, 0] - 1e-9) | (q > arm.limits[:, 1] + 1e-9)
    for k, axis in np.argwhere(outside)[:1].tolist():
        low, high = np.degrees(arm.limits[axis])
        raise FileError(
            f"{where}, line {lines[k]}",
            f"axis {axis + 1} would stand at {np.degrees(q[k, axis]):.3f}°, its limits are {low:g}° and {high:g}°",
            "move the target",
        )
