"""Kinematics as a product of exponentials (Lynch and Park, Modern Robotics, ch. 4): T = exp(S1 θ1) … exp(Sn θn) M.

The constants of the rig file (modified Denavit–Hartenberg, Craig) only position the screws at θ = 0; mm and rad.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
G_M_S2 = 9.80665


@dataclass(frozen=True)
class Constants:
    """Arm constants of a rig file: a, alpha, beta, d, zero, mass (axes,); centre (axes, 3) mm; coupling (axes,
    axes).
    """

    a: Array
    alpha: Array
    beta: Array
    d: Array
    zero: Array
    coupling: Array
    base: Array
    tool: Array
    mass: Array
    centre: Array
    payload: float


@dataclass(frozen=True)
class Arm:
    """The arm at θ = 0: a point on each axis (axes, 3), its direction (axes, 3), the link ends (axes, 3), the tool
    (4, 4); zero, coupling; centres hung (axes, 3) mm and mass (axes,) kg of the links, payload in kg.
    """

    point: Array
    axis: Array
    end: Array
    tool: Array
    zero: Array
    coupling: Array
    hung: Array
    mass: Array
    payload: float


@dataclass(frozen=True)
class Posed:
    """n postures. point, axis, end (n, axes, 3): screws and link ends; R (n, 3, 3) and p (n, 3): tool."""

    point: Array
    axis: Array
    end: Array
    R: Array
    p: Array


def placed(axis: int, angle: float, along: float = 0.0) -> Array:
    """A transform (4, 4): a rotation about x, y or z (0, 1, 2) and a translation along the same axis."""
    T = np.eye(4)
    T[:3, :3] = _turned(np.eye(3)[None], np.eye(3)[axis], np.array([angle]))[0]
    T[axis, 3] = along
    return T


def arm_from(c: Constants) -> Arm:
    """Screws of an arm, computed from link to link at θ = 0."""
    T, point, axis, end, hung = c.base, [], [], [], []
    for k in range(len(c.a)):
        T = T @ placed(0, c.alpha[k], c.a[k]) @ placed(1, c.beta[k])
        point.append(T[:3, 3])
        axis.append(T[:3, 2])
        T = T @ placed(2, 0.0, c.d[k])
        end.append(T[:3, 3])
        hung.append(T[:3, :3] @ c.centre[k] + T[:3, 3])
    stacked = [np.array(rows) for rows in (point, axis, end)]
    return Arm(*stacked, T @ c.tool, c.zero, c.coupling, np.array(hung), c.mass, c.payload)


def pose(arm: Arm, q: Array) -> Posed:
    """All screws and the tool at controller angles q (n, axes)."""
    theta = q @ arm.coupling.T + arm.zero
    n, joints = theta.shape
    point, axis, end = (np.empty((n, joints, 3)) for _ in range(3))
    R, p = np.broadcast_to(np.eye(3), (n, 3, 3)), np.zeros((n, 3))
    for k in range(joints):
        point[:, k] = _times(R, arm.point[k]) + p
        axis[:, k] = _times(R, arm.axis[k])
        R = _turned(R, arm.axis[k], theta[:, k])
        p = point[:, k] - _times(R, arm.point[k])
        end[:, k] = _times(R, arm.end[k]) + p
    return Posed(point, axis, end, _times(R, arm.tool[:3, :3]), _times(R, arm.tool[:3, 3]) + p)


def torque_nm(arm: Arm, q: Array, extra_kg: float = 0.0) -> Array:
    """Gravity torque (n, axes) Nm on the controller joints by virtual work: -d(potential)/dq.

    The payload at the flange is `extra_kg` more than in the rig file.
    """
    theta = q @ arm.coupling.T + arm.zero
    n, R, p = len(q), np.broadcast_to(np.eye(3), (len(q), 3, 3)), np.zeros((len(q), 3))
    axes, points, hung = [], [], []
    joints = theta.shape[1]
    for k in range(joints):
        points.append(_times(R, arm.point[k]) + p)
        axes.append(_times(R, arm.axis[k]))
        R = _turned(R, arm.axis[k], theta[:, k])
        p = points[k] - _times(R, arm.point[k])
        hung.append(_times(R, arm.hung[k]) + p)
    flange = _times(R, arm.end[-1]) + p
    work = np.zeros((n, joints))
    for k in range(joints):
        carried = [(mass, at) for mass, at in zip(arm.mass[k:], hung[k:], strict=True)]
        for mass, at in [*carried, (arm.payload + extra_kg, flange)]:
            rise = axes[k][:, 0] * (at - points[k])[:, 1] - axes[k][:, 1] * (at - points[k])[:, 0]
            work[:, k] -= mass * G_M_S2 * rise / 1000.0
    return work @ arm.coupling


def _turned(R: Array, axis: Array, angle: Array) -> Array:
    """Return rotations R (n, 3, 3), each followed by a rotation about a unit axis (3,) of its own frame (Rodrigues)."""
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    across = _times(R, K)
    return R + np.sin(angle)[:, None, None] * across + (1 - np.cos(angle))[:, None, None] * _times(across, K)


def _times(R: Array, other: Array) -> Array:
    """Multiply R (n, 3, 3) by the same vector (3,) or matrix (3, 3) in a single product."""
    return (R.reshape(-1, 3) @ other).reshape(len(R), 3, *other.shape[1:])
