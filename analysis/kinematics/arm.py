"""Forward kinematics and Jacobian of a six-axis arm, on stacks of joint angles.

The arm is an immutable value; everything here is a pure function of it. Angles are radians, lengths mm,
frames are homogeneous 4 × 4 matrices named `T_parent_child`. Modified Denavit–Hartenberg after Craig,
Introduction to Robotics, 3rd ed., eq. 3.6, with Hayati's angle beta between alpha and theta.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigs.robot import Pose, Robot

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Arm:
    """Constants of an arm. a, d: (6,) mm; alpha, beta, offset: (6,) rad; coupling: (6, 6);
    T_world_base, T_flange_tool: (4, 4); limits: (6, 2) rad; speed: (6,) rad/s."""

    a: Array
    alpha: Array
    beta: Array
    d: Array
    offset: Array
    coupling: Array
    T_world_base: Array
    T_flange_tool: Array
    limits: Array
    speed: Array


def arm_of(robot: Robot) -> Arm:
    """The arm that a rig file describes."""

    def column(field: str) -> Array:
        return np.array([getattr(axis, field) for axis in robot.axes], dtype=float)

    return Arm(
        a=column("a_mm"),
        alpha=np.radians(column("alpha_deg")),
        beta=np.radians(column("beta_deg")),
        d=column("d_mm"),
        offset=np.radians(column("offset_deg")),
        coupling=np.array(robot.coupling, dtype=float),
        T_world_base=transform(robot.base),
        T_flange_tool=transform(robot.tool),
        limits=np.radians(column("limits_deg")),
        speed=np.radians(column("speed_deg_s")),
    )


def transform(pose: Pose) -> Array:
    """(4, 4) frame of a pose: fixed-axis roll-pitch-yaw, R = Rz(yaw) Ry(pitch) Rx(roll)."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(np.radians(pose.rpy_deg)), np.sin(np.radians(pose.rpy_deg))
    T = np.eye(4)
    T[:3, :3] = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    T[:3, 3] = pose.xyz_mm
    return T


def link_frames(arm: Arm, q: Array) -> Array:
    """T_world_link of each joint's frame for joint angles q (n, 6): (n, 6, 4, 4)."""
    theta = q @ arm.coupling.T + arm.offset
    cosine, sine = np.cos(theta)[:, :, None], np.sin(theta)[:, :, None]
    frames = np.zeros((len(q), 6, 4, 4))
    frames[:, :, 3, 3] = 1.0
    before: Array = np.broadcast_to(arm.T_world_base[:3], (len(q), 3, 4))
    for axis in range(6):
        # One product with the joint's constants for all rows of all frames; the turn mixes two columns.
        at_zero = (before.reshape(-1, 4) @ _joint_at_zero(arm, axis)).reshape(-1, 3, 4)
        x, y, c, s = at_zero[:, :, 0], at_zero[:, :, 1], cosine[:, axis], sine[:, axis]
        before = frames[:, axis, :3]
        before[:, :, 0] = c * x + s * y
        before[:, :, 1] = c * y - s * x
        before[:, :, 2:] = at_zero[:, :, 2:]
    return frames


def _joint_at_zero(arm: Arm, axis: int) -> Array:
    """T(i-1,i) (4, 4) of one joint for theta = 0."""
    ca, sa = np.cos(arm.alpha[axis]), np.sin(arm.alpha[axis])
    cb, sb = np.cos(arm.beta[axis]), np.sin(arm.beta[axis])
    d = arm.d[axis]
    return np.array([
        [cb, 0.0, sb, arm.a[axis] + d * sb],
        [sa * sb, ca, -sa * cb, -d * sa * cb],
        [-ca * sb, sa, ca * cb, d * ca * cb],
        [0.0, 0.0, 0.0, 1.0],
    ])  # fmt: skip


def forward(arm: Arm, q: Array) -> Array:
    """T_world_tool for joint angles q (n, 6): (n, 4, 4)."""
    T: Array = link_frames(arm, q)[:, 5] @ arm.T_flange_tool
    return T


def forward_and_jacobian(arm: Arm, q: Array) -> tuple[Array, Array]:
    """T_world_tool (n, 4, 4) and the geometric Jacobian of the tool's origin (n, 6, 6).

    Rows: linear velocity in mm/rad, then angular velocity, both in the world; columns: joints of the
    controller, so that couplings are in it.
    """
    frames = link_frames(arm, q)
    T = frames[:, 5] @ arm.T_flange_tool
    axes = frames[:, :, :3, 2]
    arms = T[:, None, :3, 3] - frames[:, :, :3, 3]
    per_theta = np.concatenate([np.cross(axes, arms), axes], axis=2)
    return T, np.einsum("nik,ij->nkj", per_theta, arm.coupling)


def pose_error(T: Array, target: Array) -> Array:
    """Small motion that takes T to target, (n, 6): translation in mm, rotation vector in rad, in the world."""
    error = np.empty((len(T), 6))
    error[:, :3] = target[:, :3, 3] - T[:, :3, 3]
    R: Any = target[:, :3, :3] @ np.swapaxes(T[:, :3, :3], 1, 2)
    skew = np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=1) / 2
    # The sine alone would vanish at half a turn; the angle between keeps Newton pointing the right way.
    sine = np.linalg.norm(skew, axis=1)
    angle = np.arctan2(sine, (np.trace(R, axis1=1, axis2=2) - 1) / 2)
    error[:, 3:] = skew * (angle / np.where(sine > 1e-12, sine, 1.0) + (sine <= 1e-12))[:, None]
    return error
