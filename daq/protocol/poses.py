"""Poses in controller messages, converted to the columns of a run: x, y, z in mm, roll, pitch, yaw in degrees.

Angles are about fixed axes, and turns are quaternions w, x, y, z. Six numbers a sample do not justify numpy, whose
calls would take longer.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

Vector = Sequence[float]
Quaternion = tuple[float, float, float, float]


def turn_by(vector: Vector) -> Quaternion:
    """Turn by a rotation vector in rad."""
    half = math.hypot(*vector) / 2
    x, y, z = (part / 2 * (math.sin(half) / half if half else 1.0) for part in vector)
    return math.cos(half), x, y, z


def columns_of(turn: Vector, place_mm: Vector) -> tuple[float, ...]:
    """Columns of a frame. turn: of any length above zero."""
    length = math.hypot(*turn)
    w, x, y, z = (part / length for part in turn)
    across, along = 2 * (x * y + w * z), 1 - 2 * (y * y + z * z)
    pitch = math.atan2(2 * (w * y - x * z), math.hypot(across, along))
    if math.hypot(across, along) < 1e-9:  # upright: roll and yaw are the same
        roll, yaw = 0.0, math.atan2(2 * (w * z - x * y), 1 - 2 * (x * x + z * z))
    else:
        roll, yaw = math.atan2(2 * (y * z + w * x), 1 - 2 * (x * x + y * y)), math.atan2(across, along)
    return (*place_mm, *map(math.degrees, (roll, pitch, yaw)))


def flange_pose(tool: Vector, offset: Vector) -> tuple[float, ...]:
    """Columns of the flange in the base, from the tool in the base and in the flange.

    Both are x, y, z in m and a rotation vector in rad, as Universal Robots send them.
    """
    turn = _product(turn_by(tool[3:]), _inverse(turn_by(offset[3:])))
    return columns_of(turn, [1000 * (at - part) for at, part in zip(tool[:3], _turned(turn, offset[:3]), strict=True)])


def quaternion_of(rpy_deg: Vector) -> Quaternion:
    roll, pitch, yaw = (math.radians(angle) for angle in rpy_deg)
    return _product(_product(turn_by((0, 0, yaw)), turn_by((0, pitch, 0))), turn_by((roll, 0, 0)))


def tool_fields(flange: Vector, offset: Vector) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Inverse of `flange_pose`: the tool in the base and in the flange."""
    turn = quaternion_of(flange[3:])
    place = [at / 1000 + part for at, part in zip(flange[:3], _turned(turn, offset[:3]), strict=True)]
    w, *axis = _product(turn, turn_by(offset[3:]))
    length = math.hypot(*axis)
    angle = math.copysign(2 * math.atan2(length, abs(w)), w)
    return (*place, *(angle * part / length if length else 0.0 for part in axis)), tuple(offset)


def _product(a: Quaternion, b: Quaternion) -> Quaternion:
    (w, x, y, z), (p, q, r, s) = a, b
    return (
        w * p - x * q - y * r - z * s,
        w * q + x * p + y * s - z * r,
        w * r - x * s + y * p + z * q,
        w * s + x * r - y * q + z * p,
    )


def _inverse(turn: Quaternion) -> Quaternion:
    w, x, y, z = turn
    return w, -x, -y, -z


def _turned(turn: Quaternion, vector: Vector) -> tuple[float, ...]:
    x, y, z = vector
    return _product(_product(turn, (0.0, x, y, z)), _inverse(turn))[1:]
