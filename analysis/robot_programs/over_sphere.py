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
from analysis.robot_programs.ways import around, middle_of, rotation_vector, turned
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
    turn = float(np.linalg.norm(rotation_vector(begin.T, end.T)))
    via = None
    if np.linalg.norm(end.T[:3, 3] - begin.T[:3, 3]) > _SAME_PLACE_MM:
        via = middle_of(begin.T, end.T, centre_mm, radius_mm)
        way = around(begin.T, via[:3, 3], end.T, _MOVE_MM_S)
    elif turn > _SAME_RAD:
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
