"""Modified Denavit-Hartenberg constants from joint axes given as lines in space.

The axes determine the kinematics completely, independent of the frames used by a source. The common normal of two lines
gives Craig's a and alpha. For nearly parallel lines the common normal is ill-conditioned. In this case the next axis is
intersected with the plane through the previous origin, and rotated by Hayati's beta (S. Hayati, M. Mirmirani, Improving
the Absolute Positioning Accuracy of Robot Manipulators, 1985). Both constructions are exact: the axes remain the same
lines.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.robot.kinematics.arm import Array
from rigs.schema.robot import Rail

_PARALLEL = 0.1
"""Sine of the angle between axes below which beta is used: 6 degrees. Above it, the foot of the common normal is
less than ten axis distances away, which is still a plausible link length. Nominal angles of 0 and 90 degrees are
not affected.
"""
_MEET_MM = 1e-6
"""Distance below which axes intersect. Sources are rounded to a micrometre or finer."""


@dataclass(frozen=True)
class AxisLines:
    """Axes of an arm in the base frame, with all joints at zero: a point (axes, 3) mm and the direction of positive
    rotation (axes, 3) of each, and the flange.
    """

    points: Array
    directions: Array
    T_base_flange: Array
    rail: Rail | None = None


@dataclass(frozen=True)
class DenavitHartenberg:
    """Denavit-Hartenberg constants of an arm in mm and rad.

    senses (axes,): 1 or -1, with theta = senses · q + offset. base_mm (3,): start of the first axis. T_base_link (axes,
    4, 4): joint frames with all joints at zero. T_last_flange: without rotation about and translation along the last
    axis.
    """

    a: Array
    alpha: Array
    beta: Array
    d: Array
    offset: Array
    senses: Array
    base_mm: Array
    T_base_link: Array
    T_last_flange: Array


@dataclass(frozen=True)
class _Step:
    """Link constants alpha, beta (rad) and a (mm), with origin and x axis before the rotation of the next joint."""

    alpha: float
    a: float
    beta: float
    origin: Array
    x: Array


def denavit_hartenberg(axes: AxisLines) -> DenavitHartenberg:
    """Constants from the axes of an arm, joint by joint from the base.

    The z axes of the first and the last joint point in the directions of those of base and flange; the x axes give the
    smallest offsets.
    """
    senses = np.ones(len(axes.directions))
    senses[0] = -1.0 if axes.directions[0, 2] < 0 else 1.0
    senses[-1] = -1.0 if axes.directions[-1] @ axes.T_base_flange[:3, 2] < 0 else 1.0
    z = axes.directions * senses[:, None]
    base = axes.points[0] - (axes.points[0] @ z[0]) * z[0]
    step = _turned(base, np.eye(3), z[0], a=0.0)
    steps, offsets, ds, frames = [step], [], [], []
    for axis in range(len(z) - 1):
        origin, x, step = _linked(step, z[axis], axes.points[axis], z[axis + 1], axes.points[axis + 1])
        ds.append((origin - steps[-1].origin) @ z[axis])
        offsets.append(_angle(steps[-1].x, x, z[axis]))
        frames.append(_frame(x, z[axis], origin))
        steps.append(step)
    # Use origin and x axis of the flange for the last axis, as far as its direction permits.
    flange_x, flange = axes.T_base_flange[:3, 0], axes.T_base_flange[:3, 3]
    x = flange_x - (flange_x @ z[-1]) * z[-1]
    length = float(np.linalg.norm(x))
    origin, x = step.origin + ((flange - step.origin) @ z[-1]) * z[-1], x / length if length > _PARALLEL else step.x
    ds.append((origin - step.origin) @ z[-1])
    offsets.append(_angle(step.x, x, z[-1]))
    frames.append(_frame(x, z[-1], origin))
    return DenavitHartenberg(
        a=np.array([link.a for link in steps]),
        alpha=np.array([link.alpha for link in steps]),
        beta=np.array([link.beta for link in steps]),
        d=np.array(ds),
        offset=np.array(offsets),
        senses=senses,
        base_mm=base,
        T_base_link=np.array(frames),
        T_last_flange=np.linalg.inv(frames[-1]) @ axes.T_base_flange,
    )


def _linked(before: _Step, z: Array, point: Array, z_next: Array, point_next: Array) -> tuple[Array, Array, _Step]:
    """Origin and x axis on the axis through point with direction z, and the step to the next."""
    normal = np.cross(z, z_next)
    sine = float(np.linalg.norm(normal))
    if sine < _PARALLEL:
        along = ((before.origin - point_next) @ z) / (z_next @ z)
        way = point_next + along * z_next - before.origin
        length = float(np.linalg.norm(way))
        x = _towards(before.x, way / length) if length > _MEET_MM else before.x
        turn = np.column_stack([x, np.cross(z, x), z])
        return before.origin, x, _turned(before.origin, turn, z_next, a=float(way @ x))
    x = _towards(before.x, normal / sine)
    apart = point_next - point
    foot = point + (np.cross(apart, z_next) @ normal) / sine**2 * z
    foot_next = point_next + (np.cross(apart, z) @ normal) / sine**2 * z_next
    alpha = float(np.arctan2(normal @ x, z @ z_next))
    return foot, x, _Step(alpha, float((foot_next - foot) @ x), 0.0, foot_next, x)


def _turned(origin: Array, R: Array, z_next: Array, a: float) -> _Step:
    """Step from a frame at origin to the axis z_next, which intersects the frame's x axis at a."""
    x, y, z = R.T @ z_next
    beta, alpha = float(np.arcsin(np.clip(x, -1.0, 1.0))), float(np.arctan2(-y, z))
    x_next = R @ [np.cos(beta), np.sin(alpha) * np.sin(beta), -np.cos(alpha) * np.sin(beta)]
    return _Step(alpha, a, beta, origin + a * R[:, 0], x_next)


def _towards(before: Array, x: Array) -> Array:
    return -x if before @ x < -_MEET_MM else x


def _angle(start: Array, end: Array, z: Array) -> float:
    return float(np.arctan2(np.cross(start, end) @ z, start @ end))


def _frame(x: Array, z: Array, origin: Array) -> Array:
    T = np.eye(4)
    T[:3] = np.column_stack([x, np.cross(z, x), z, origin])
    return T
