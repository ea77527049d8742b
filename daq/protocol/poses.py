"""Poses in controller messages: rotation vectors and quaternions, converted to the columns of a run.

A frame is a rotation matrix as three rows, and a position. The columns are x, y, z in mm, then roll, pitch, yaw in
degrees about fixed axes. Six numbers a sample do not justify numpy, whose calls would take longer.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

Matrix = tuple[tuple[float, float, float], ...]
Vector = Sequence[float]


def rotation_of(vector: Vector) -> Matrix:
    angle = math.hypot(*vector)
    x, y, z = (part / angle for part in vector) if angle else (1.0, 0.0, 0.0)
    c, s = math.cos(angle), math.sin(angle)
    v = 1 - c
    return (
        (c + x * x * v, x * y * v - z * s, x * z * v + y * s),
        (y * x * v + z * s, c + y * y * v, y * z * v - x * s),
        (z * x * v - y * s, z * y * v + x * s, c + z * z * v),
    )


def rotation_of_quaternion(w: float, x: float, y: float, z: float) -> Matrix:
    length = math.hypot(w, x, y, z)
    half = math.atan2(math.hypot(x, y, z), w)
    part = math.hypot(x, y, z) or length
    return rotation_of([2 * half * axis / part for axis in (x, y, z)])


def columns_of(R: Matrix, place_mm: Vector) -> tuple[float, ...]:
    """Columns of a frame: x, y, z in mm, roll, pitch, yaw in degrees about fixed axes."""
    pitch = math.atan2(-R[2][0], math.hypot(R[0][0], R[1][0]))
    upright = math.hypot(R[0][0], R[1][0]) < 1e-9
    roll = 0.0 if upright else math.atan2(R[2][1], R[2][2])
    yaw = math.atan2(-R[0][1], R[1][1]) if upright else math.atan2(R[1][0], R[0][0])
    return (*place_mm, *map(math.degrees, (roll, pitch, yaw)))


def flange_pose(tool: Vector, offset: Vector) -> tuple[float, ...]:
    """Columns of the flange in the base, from the tool in the base and in the flange.

    Both are x, y, z in m and a rotation vector in rad, as Universal Robots send them.
    """
    back = zip(*rotation_of(offset[3:]), strict=True)
    R = _product(rotation_of(tool[3:]), tuple(back))
    place = [at - part for at, part in zip(tool[:3], _turned(R, offset[:3]), strict=True)]
    return columns_of(R, [1000 * part for part in place])


def quaternion_of(rpy_deg: Vector) -> tuple[float, ...]:
    """Quaternion w, x, y, z of roll, pitch and yaw in degrees about fixed axes."""
    vector = _vector_of(_rotation_of_rpy(rpy_deg))
    angle = math.hypot(*vector)
    part = math.sin(angle / 2) / angle if angle else 0.5
    return (math.cos(angle / 2), *(part * axis for axis in vector))


def tool_fields(flange: Vector, offset: Vector) -> tuple[tuple[float, ...], tuple[float, ...]]:
    R = _rotation_of_rpy(flange[3:])
    place = [at / 1000 + part for at, part in zip(flange[:3], _turned(R, offset[:3]), strict=True)]
    return (*place, *_vector_of(_product(R, rotation_of(offset[3:])))), tuple(offset)


def _rotation_of_rpy(rpy_deg: Vector) -> Matrix:
    roll, pitch, yaw = (math.radians(angle) for angle in rpy_deg)
    return _product(_product(rotation_of((0, 0, yaw)), rotation_of((0, pitch, 0))), rotation_of((roll, 0, 0)))


def _vector_of(R: Matrix) -> tuple[float, ...]:
    """Rotation vector in rad, by the quaternion, which is exact at half a turn as well."""
    (a, b, c), (d, e, f), (g, h, i) = R
    squares = (1 + a + e + i, 1 + a - e - i, 1 - a + e - i, 1 - a - e + i)
    rows = (
        (squares[0], h - f, c - g, d - b),
        (h - f, squares[1], b + d, c + g),
        (c - g, b + d, squares[2], f + h),
        (d - b, c + g, f + h, squares[3]),
    )
    w, x, y, z = rows[squares.index(max(squares))]
    length, sign = math.hypot(x, y, z), -1.0 if w < 0 else 1.0
    angle = 2 * math.atan2(length, abs(w))
    return tuple(sign * angle * part / length if length else 0.0 for part in (x, y, z))


def _product(A: Matrix, B: Matrix) -> tuple[tuple[float, float, float], ...]:
    (a, b, c), (d, e, f), (g, h, i) = B
    return tuple((x * a + y * d + z * g, x * b + y * e + z * h, x * c + y * f + z * i) for x, y, z in A)


def _turned(R: Matrix, vector: Vector) -> list[float]:
    x, y, z = vector
    return [a * x + b * y + c * z for a, b, c in R]
