"""An arm as joints that turn about z of frames which stand fixed in the frame before: what URDF and the driver of
Universal Robots have in common."""

from __future__ import annotations

import numpy as np

from analysis.kinematics.arm import Arm, Array, roll_pitch_yaw
from rigs.errors import FileError

RAIL_JOINT = "rail"
"""The name of the joint that is a rail."""
_ZERO = 1e-15
"""Metres and rad below which a number is the rounding of zero; a thousandth of what a file may differ from its arm."""


def joint_senses(arm: Arm, where: str, kind: str) -> list[int]:
    """Return 1 or -1 for each joint (6): the sense in which its axis turns with the controller's angle.

    Raises FileError where an axis turns with the angle of another joint, or by another ratio. kind: of file.
    """
    senses = np.sign(np.diag(arm.coupling))
    if not np.array_equal(arm.coupling, np.diag(senses)) or not senses.all():
        wrong = (arm.coupling != np.diag(senses)).any(axis=1) | (senses == 0)
        axis = int(np.flatnonzero(wrong)[0]) + 1
        problem = f"axis {axis} does not turn with joint {axis} alone and one to one, and {kind} has no way to say so"
        remedy = (
            "in a copy, set coupling to its signs, and turn the controller's angles into those of the axes beforehand"
        )
        raise FileError(f"{where}, robot.coupling", problem, remedy)
    return [int(sense) for sense in senses]


def joint_origins(arm: Arm) -> Array:
    """Return the frames (6, 4, 4) of the joints, in mm, each in the frame that the joint before it moves; all joint
    angles zero."""
    c, s = np.cos(arm.offset), np.sin(arm.offset)
    turned = np.tile(np.eye(4), (len(arm.a), 1, 1))
    turned[:, 0, 0], turned[:, 0, 1], turned[:, 1, 0], turned[:, 1, 1] = c, -s, s, c
    return np.asarray(arm.links_at_zero @ turned)


def rail_way(arm: Arm) -> Array:
    """Return the direction (3,) of an arm's rail in the frame of its base."""
    assert arm.rail is not None  # noqa: S101 - asked for rails alone
    way: Array = arm.T_world_base[:3, :3].T @ arm.rail
    return way / np.linalg.norm(way)


def metres_and_rpy(T: Array) -> tuple[list[float], list[float]]:
    """Return x, y, z in metres and roll, pitch, yaw in rad of a frame (4, 4) in mm."""
    xyz, rpy = T[:3, 3] / 1000.0, roll_pitch_yaw(T)
    return [_written(value) for value in xyz], [_written(value) for value in rpy]


def _written(value: float) -> float:
    return 0.0 if abs(value) < _ZERO else float(value)
