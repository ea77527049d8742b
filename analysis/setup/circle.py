"""The circle whose start the robot stands at: from its joints and the nominal arm, one pose says all of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analysis.kinematics.arm import Array, arm_of, forward
from rigs.schema.declared_tests import Circle
from rigs.schema.part import Vector
from rigs.schema.robot import Robot


def circle_from_start(robot: Robot, joints_deg: Sequence[float], radius_mm: float) -> Circle:
    """Return the circle that begins at these joint angles.

    On a circle the tool's z axis points at the centre and its x axis along the normal (docs/conventions.md).
    """
    T = forward(arm_of(robot), np.radians([joints_deg]))[0]
    towards, normal = T[:3, 2], T[:3, 0]
    return Circle(
        centre_mm=_vector(T[:3, 3] + radius_mm * towards, 3),
        normal=_vector(normal, 6),
        zero=_vector(-towards, 6),
        radius_mm=radius_mm,
        posture_deg=tuple(round(float(angle), 3) for angle in joints_deg),
    )


def _vector(values: Array, decimals: int) -> Vector:
    """Three numbers (3,), rounded to what is known of them."""
    x, y, z = (round(float(value), decimals) + 0.0 for value in values)
    return x, y, z
