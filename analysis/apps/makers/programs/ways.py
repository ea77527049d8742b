"""The way of the tool between two poses, along which the arm is followed before a move is planned.

An arm may reach both ends of a move and nothing between them, or pass a singularity there. On each way the tool turns
evenly about one axis; poses are (4, 4) and (n, 4, 4), places in mm.

Between targets of the hemisphere the tool stays at the link's length from the base-ball. A joint move between two
targets takes the tool off the sphere by centimetres and more, which no link can follow. An arc about the ball keeps to
it, and a turn where two targets are the same place in different orientations.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from analysis.apps.makers.programs.motion_plan import Arc, Hold, JointMove, Step, Target, Turn
from analysis.robot.geometry.circle import circles_through
from analysis.robot.geometry.driven_programs import JOINT_SPEED
from analysis.robot.kinematics.arm import Arm, Array
from analysis.robot.kinematics.follow import follow
from analysis.robot.kinematics.joint_limits import SAME_RAD
from rigs.errors import FileError

_STEP_MM = 4.0
_STEP_RAD = np.radians(4.0)
"""Half of this between samples; joints move smoothly in between."""
_OPPOSITE = 1e-6
"""Places whose middle is so near to the centre, in radii, are opposite: rounding would choose the way between them."""


@dataclass(frozen=True)
class Way:
    """Poses (n, 4, 4) at even distances, an odd number of them; seconds: how long the way takes at its speed."""

    poses: Array
    seconds: float

    def joint_speeds(self, q: Array) -> Array:
        """Return the maximum speed (6,) rad/s of each joint for joint angles q (n, 6) rad along this path."""
        fastest: Array = np.abs(np.diff(q, axis=0)).max(axis=0) * (len(q) - 1) / self.seconds
        return fastest


def straight(begin: Array, end: Array, speed_mm_s: float) -> Way:
    """Return the straight path from one pose (4, 4) to another."""
    way_mm = end[:3, 3] - begin[:3, 3]
    length = float(np.linalg.norm(way_mm))
    share = _shares(length, 0.0)
    return _way(begin, end, share, begin[:3, 3] + share[:, None] * way_mm, length / speed_mm_s)


def turned(begin: Array, end: Array, speed_rad_s: float) -> Way:
    """Return the rotation about the tool's origin from one pose (4, 4) to another."""
    angle = float(np.linalg.norm(rotation_vector(begin, end)))
    share = _shares(0.0, angle)
    return _way(begin, end, share, np.tile(begin[:3, 3], (len(share), 1)), angle / speed_rad_s)


def around(begin: Array, via_mm: Array, end: Array, speed_mm_s: float) -> Way:
    """Return the circular path from one pose (4, 4) through a position (3,) mm to another pose."""
    centres, axes, _ = circles_through(np.stack([begin[:3, 3], via_mm, end[:3, 3]])[None])
    centre, axis = centres[0], axes[0]
    arm = begin[:3, 3] - centre
    to_end = end[:3, 3] - centre
    angle = float(np.arctan2(axis @ np.cross(arm, to_end), arm @ to_end) % (2 * np.pi))
    length = angle * float(np.linalg.norm(arm))
    share = _shares(length, angle)
    return _way(begin, end, share, centre + _rotations(angle * axis, share) @ arm, length / speed_mm_s)


def _way(begin: Array, end: Array, share: Array, places: Array, seconds: float) -> Way:
    poses = np.tile(begin, (len(share), 1, 1))
    poses[:, :3, 3] = places
    poses[:, :3, :3] = _rotations(rotation_vector(begin, end), share) @ begin[:3, :3]
    return Way(poses, seconds)


def middle_of(begin: Array, end: Array, centre_mm: Array, radius_mm: float) -> Array:
    """The pose (4, 4) half way between two on a sphere about centre_mm (3,), places in mm.

    Between opposite places it is where the tool, turned half way, points to the centre.
    """
    T = np.eye(4)
    T[:3, :3] = _rotations(rotation_vector(begin, end), np.array([0.5]))[0] @ begin[:3, :3]
    aside = (begin[:3, 3] + end[:3, 3]) / 2 - centre_mm
    if np.linalg.norm(aside) < _OPPOSITE * radius_mm:
        aside = -T[:3, 2]
    T[:3, 3] = centre_mm + radius_mm * aside / np.linalg.norm(aside)
    return T


def _shares(length_mm: float, angle: float) -> Array:
    return np.linspace(0, 1, 3 + 2 * int(max(length_mm / _STEP_MM, angle / _STEP_RAD)))


def rotation_vector(begin: Array, end: Array) -> Array:
    """Return the rotation vector (3,) rad in the base frame from one pose (4, 4) to another."""
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - slow to import, needed here only

    vector: Array = Rotation.from_matrix(end[:3, :3] @ begin[:3, :3].T).as_rotvec()
    return vector


def _rotations(vector: Array, share: Array) -> Array:
    """Return the rotations (n, 3, 3) by fractions (n,) of a rotation vector (3,) rad."""
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - slow to import, needed here only

    matrices: Array = Rotation.from_rotvec(share[:, None] * vector).as_matrix()
    return matrices


_MOVE_MM_S = 100.0
_TURN_RAD_S = np.radians(20.0)
"""Between targets: 30° on a sphere of 400 mm in 2 s."""
_SHARE_OF_SPEED = 0.5
"""No joint moves faster than half of what it can between targets, so that a controller need not slow the tool down."""
_LEAST_SHARE = 0.05
"""Slower than a twentieth the arm is so near a singularity that a joint move is the better way."""
_SAME_PLACE_MM = 1e-6
"""The rounding of places that are meant to be the same."""


def over_sphere(arm: Arm, begin: Target, end: Target, centre_mm: Array, radius_mm: float) -> tuple[list[Step], Target]:
    """The steps between two targets on a sphere about centre_mm (3,) in the base frame, and where the arm then stands.

    That may be another of its solutions than the target's. Where the arm cannot follow the way, or only slowly, a
    person takes the link off for a joint move.
    """
    turn = float(np.linalg.norm(rotation_vector(begin.T, end.T)))
    via = None
    if np.linalg.norm(end.T[:3, 3] - begin.T[:3, 3]) > _SAME_PLACE_MM:
        via = middle_of(begin.T, end.T, centre_mm, radius_mm)
        way = around(begin.T, via[:3, 3], end.T, _MOVE_MM_S)
    elif turn > SAME_RAD:
        way = turned(begin.T, end.T, _TURN_RAD_S)
    else:
        return [], begin
    try:
        q = follow(arm, arm.T_world_base @ way.poses, begin.q, "a way over the sphere")
    except FileError:
        return _without_link(end), end
    share = min(1.0, _SHARE_OF_SPEED / float((way.joint_speeds(q) / arm.speed).max()))
    if share < _LEAST_SHARE:
        return _without_link(end), end
    arrived = replace(end, q=q[-1])
    if via is None:
        return [Turn(arrived, turn, share * _TURN_RAD_S, q=q)], arrived
    return [Arc(Target(via, q[len(q) // 2]), arrived, share * _MOVE_MM_S, q=q)], arrived


def _without_link(end: Target) -> list[Step]:
    return [Hold("take the link off and continue"), JointMove(end, JOINT_SPEED), Hold("mount the link and continue")]
