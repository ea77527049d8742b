"""Ways between targets of the hemisphere that keep the tool at the link's length from the base-ball.

A joint move between two targets takes the tool off the sphere by centimetres and more, which no link can follow. An arc
about the ball keeps to it, and a turn where two targets are the same place in different orientations.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analysis.geometry.programs import JOINT_SPEED
from analysis.kinematics.arm import Arm, Array
from analysis.kinematics.follow import follow
from analysis.robot_programs.plan import Arc, Hold, JointMove, Step, Target, Turn
from analysis.robot_programs.ways import middle_of, rotation_vector, way_of
from rigs.errors import FileError

_MOVE_MM_S = 100.0
_TURN_RAD_S = np.radians(20.0)
"""Between targets: 30° on a sphere of 400 mm in 2 s."""
_SHARE_OF_SPEED = 0.5
"""No joint moves faster than half of what it can between targets, so that a controller need not slow the tool down."""
_LEAST_SHARE = 0.05
"""Slower than a twentieth the arm is so near a singularity that a joint move is the better way."""
_SAME_PLACE_MM, _SAME_RAD = 1e-6, 1e-6
"""The rounding of places and orientations that are meant to be the same."""


def over_sphere(arm: Arm, begin: Target, end: Target, centre_mm: Array, radius_mm: float) -> tuple[list[Step], Target]:
    """The steps between two targets on a sphere about centre_mm (3,) in the base frame, and where the arm then stands.

    That may be another of its solutions than the target's. Where the arm cannot follow the way, or only slowly, a
    person takes the link off for a joint move.
    """
    move = _planned(begin, end, centre_mm, radius_mm)
    if move is None:
        return [], begin
    way = way_of(begin.T, move)
    try:
        q = follow(arm, arm.T_world_base @ way.poses, begin.q, "a way over the sphere")
    except FileError:
        return _without_link(end), end
    share = min(1.0, _SHARE_OF_SPEED / float((way.joint_speeds(q) / arm.speed).max()))
    if share < _LEAST_SHARE:
        return _without_link(end), end
    arrived = replace(end, q=q[-1])
    if isinstance(move, Turn):
        return [replace(move, target=arrived, speed_rad_s=share * _TURN_RAD_S)], arrived
    via = replace(move.via, q=q[len(q) // 2])
    return [replace(move, via=via, end=arrived, speed_mm_s=share * _MOVE_MM_S)], arrived


def _without_link(end: Target) -> list[Step]:
    return [Hold("take the link off and continue"), JointMove(end, JOINT_SPEED), Hold("mount the link and continue")]


def _planned(begin: Target, end: Target, centre_mm: Array, radius_mm: float) -> Turn | Arc | None:
    """The way over the sphere before the arm has a say in it, None between two that are the same."""
    angle = float(np.linalg.norm(rotation_vector(begin.T, end.T)))
    if np.linalg.norm(end.T[:3, 3] - begin.T[:3, 3]) > _SAME_PLACE_MM:
        return Arc(Target(middle_of(begin.T, end.T, centre_mm, radius_mm), begin.q), end, _MOVE_MM_S)
    return Turn(end, angle, _TURN_RAD_S) if angle > _SAME_RAD else None
