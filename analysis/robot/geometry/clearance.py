"""Postures clear of the cell: above the floor, away from the robot's column, and not near a singularity.

The arm is a chain of lines between joint frames and tool; its covers are unknown. Safety distances include the covers
of common arms, and the operator supervises the first run.
"""

from __future__ import annotations

import numpy as np

from analysis.robot.kinematics.arm import Arm, Array, Mask, forward, link_frames
from analysis.robot.kinematics.newton import conditioning

_FLOOR_MM = 100.0
"""Smallest height of the elbow and all later joints above the mounting plane of the base."""
_COLUMN_MM = 250.0
"""Smallest distance of wrist and tool from axis 1, below and at shoulder height."""
_LEAST_CONDITIONING = 0.01


def is_clear(arm: Arm, q: Array) -> Mask:
    """Mask (n,) of postures at a distance from the floor, from axis 1 and from singularities."""
    return np.asarray(is_collision_free(arm, q) & (conditioning(arm, q) > _LEAST_CONDITIONING))


def is_collision_free(arm: Arm, q: Array) -> Mask:
    """Mask (n,) of postures at a distance from the floor and from axis 1."""
    points = chain_points(arm, q)
    outer, last = points[:, 2:], points[:, 4:]  # from the elbow on, and from the wrist on
    off_column = (np.hypot(last[..., 0], last[..., 1]) > _COLUMN_MM) | (last[..., 2] > points[:, 1:2, 2] + _COLUMN_MM)
    return np.asarray((outer[..., 2] > _FLOOR_MM).all(axis=1) & off_column.all(axis=1))


def chain_points(arm: Arm, q: Array) -> Array:
    frames = np.concatenate([link_frames(arm, q), forward(arm, q)[:, None]], axis=1)
    return np.asarray(in_base(arm, frames)[..., :3, 3])


def in_base(arm: Arm, T: Array) -> Array:
    return np.asarray(np.linalg.inv(arm.T_world_base) @ T)
