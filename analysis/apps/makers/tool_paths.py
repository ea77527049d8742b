"""Paths of the tool between two poses, used to check that the arm can follow a move.

Along each path the tool rotates evenly about a fixed axis. Poses are (4, 4) and (n, 4, 4), with positions in mm.

Between targets of the hemisphere the tool moves on an arc about the ball, or turns: no link can follow a joint move.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from analysis.apps.makers.motion_plan import Arc, Hold, JointMove, PlannedTarget, Step, ToolRotation
from analysis.robot.geometry.circle import circles_through
from analysis.robot.geometry.driven_programs import JOINT_SPEED
from analysis.robot.kinematics.arm import Arm, Array
from analysis.robot.kinematics.follow import follow
from analysis.robot.kinematics.joint_limits import SAME_RAD
from rigs.errors import FileError

_STEP_MM = 4.0
_STEP_RAD = np.radians(4.0)
"""Twice the maximum rotation between samples; joints move smoothly in between."""
_OPPOSITE = 1e-6
"""Distance from the centre, in radii, of the midpoint of opposite positions, between which rounding would determine the
direction of an arc."""


@dataclass(frozen=True)
class ToolPath:
    """Poses (n, 4, 4) at equal distances, n odd."""

    poses: Array
    seconds: float

    def joint_speeds(self, q: Array) -> Array:
        """Maximum speeds (6,) rad/s for joint angles q (n, 6) rad along this path."""
        fastest: Array = np.abs(np.diff(q, axis=0)).max(axis=0) * (len(q) - 1) / self.seconds
        return fastest

    def followed(self, arm: Arm, begin: Array, where: str) -> Array:
        """Joint angles (n, 6) rad along this path in the robot's base frame, from `begin` (6,) rad.

        Raises FileError if the arm cannot follow, or a joint is too slow.
        """
        q = follow(arm, arm.T_world_base @ self.poses, begin, where)
        for axis in np.flatnonzero(self.joint_speeds(q) > arm.speed):
            problem = f"axis {axis + 1} is too slow for the path"
            raise FileError(where, problem, "move the test away from the singularity", code="path.impossible")
        return q


def straight_path(begin: Array, end: Array, speed_mm_s: float, shares: Array | None = None) -> ToolPath:
    """Straight path from one pose (4, 4) to another, at shares (n,) or every 4 mm."""
    step_mm = end[:3, 3] - begin[:3, 3]
    length = float(np.linalg.norm(step_mm))
    share = _shares(length, 0.0) if shares is None else shares
    return _tool_path(begin, end, share, begin[:3, 3] + share[:, None] * step_mm, length / speed_mm_s)


def rotation_path(begin: Array, end: Array, speed_rad_s: float, shares: Array | None = None) -> ToolPath:
    """Rotation about the tool's origin from one pose (4, 4) to another, at shares (n,) or every 4°."""
    angle = float(np.linalg.norm(rotation_vector(begin, end)))
    share = _shares(0.0, angle) if shares is None else shares
    return _tool_path(begin, end, share, np.tile(begin[:3, 3], (len(share), 1)), angle / speed_rad_s)


def circular_path(begin: Array, via_mm: Array, end: Array, speed_mm_s: float, shares: Array | None = None) -> ToolPath:
    """Circular path from one pose (4, 4) through a position (3,) mm to another, at shares (n,) or every 4 mm or 4°."""
    centres, axes, _ = circles_through(np.stack([begin[:3, 3], via_mm, end[:3, 3]])[None])
    centre, axis = centres[0], axes[0]
    arm = begin[:3, 3] - centre
    to_end = end[:3, 3] - centre
    angle = float(np.arctan2(axis @ np.cross(arm, to_end), arm @ to_end) % (2 * np.pi))
    length = angle * float(np.linalg.norm(arm))
    share = _shares(length, angle) if shares is None else shares
    return _tool_path(begin, end, share, centre + rotations(angle * axis, share) @ arm, length / speed_mm_s)


def _tool_path(begin: Array, end: Array, share: Array, places: Array, seconds: float) -> ToolPath:
    poses = np.tile(begin, (len(share), 1, 1))
    poses[:, :3, 3] = places
    poses[:, :3, :3] = rotations(rotation_vector(begin, end), share) @ begin[:3, :3]
    return ToolPath(poses, seconds)


def _middle(begin: Array, end: Array, centre_mm: Array, radius_mm: float) -> Array:
    """Pose (4, 4) midway between two poses on a sphere. For opposite positions the tool points to the centre there."""
    T = np.eye(4)
    T[:3, :3] = rotations(rotation_vector(begin, end), np.array([0.5]))[0] @ begin[:3, :3]
    aside = (begin[:3, 3] + end[:3, 3]) / 2 - centre_mm
    if np.linalg.norm(aside) < _OPPOSITE * radius_mm:
        aside = -T[:3, 2]
    T[:3, 3] = centre_mm + radius_mm * aside / np.linalg.norm(aside)
    return T


def _shares(length_mm: float, angle: float) -> Array:
    return np.linspace(0, 1, 3 + 2 * int(max(length_mm / _STEP_MM, angle / _STEP_RAD)))


def rotation_vector(begin: Array, end: Array) -> Array:
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - slow to import, needed here only

    vector: Array = Rotation.from_matrix(end[:3, :3] @ begin[:3, :3].T).as_rotvec()
    return vector


def rotations(vector: Array, share: Array) -> Array:
    """Rotations (n, 3, 3) by multiples (n,) of a rotation vector (3,) rad."""
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - slow to import, needed here only

    matrices: Array = Rotation.from_rotvec(share[:, None] * vector).as_matrix()
    return matrices


_MOVE_MM_S = 100.0
_TURN_RAD_S = np.radians(20.0)
"""Speed between targets: 30° on a sphere of 400 mm in 2 s."""
_SHARE_OF_SPEED = 0.5
"""Maximum speed of a joint between targets, as a share of its limit, so the controller need not slow down the tool."""
_LEAST_SHARE = 0.05
"""Share of the speed below which the arm is near a singularity, and a joint move is preferable."""
_SAME_PLACE_MM = 1e-6


def moves_over_sphere(
    arm: Arm, begin: PlannedTarget, end: PlannedTarget, centre_mm: Array, radius_mm: float
) -> tuple[list[Step], PlannedTarget]:
    """Steps between two targets on a sphere about centre_mm (3,) in the base frame, and the target reached.

    It may differ from `end` in the configuration. If the arm cannot follow the path, the operator removes the link.
    """
    turn = float(np.linalg.norm(rotation_vector(begin.T, end.T)))
    via = None
    if np.linalg.norm(end.T[:3, 3] - begin.T[:3, 3]) > _SAME_PLACE_MM:
        via = _middle(begin.T, end.T, centre_mm, radius_mm)
        path = circular_path(begin.T, via[:3, 3], end.T, _MOVE_MM_S)
    elif turn > SAME_RAD:
        path = rotation_path(begin.T, end.T, _TURN_RAD_S)
    else:
        return [], begin
    try:
        q = follow(arm, arm.T_world_base @ path.poses, begin.q, "a path over the sphere")
    except FileError:
        return _without_link(end), end
    share = min(1.0, _SHARE_OF_SPEED / float((path.joint_speeds(q) / arm.speed).max()))
    if share < _LEAST_SHARE:
        return _without_link(end), end
    arrived = replace(end, q=q[-1])
    if via is None:
        return [ToolRotation(arrived, turn, share * _TURN_RAD_S, q=q)], arrived
    return [Arc(PlannedTarget(via, q[len(q) // 2]), arrived, share * _MOVE_MM_S, q=q)], arrived


def _without_link(end: PlannedTarget) -> list[Step]:
    return [Hold("remove the link, then continue"), JointMove(end, JOINT_SPEED), Hold("mount the link, then continue")]
