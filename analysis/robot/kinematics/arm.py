"""Forward kinematics and Jacobian of an arm, on stacks of joint angles.

The arm is an immutable value, and all functions are pure. Angles are in radians, lengths in mm. Frames are homogeneous
4 × 4 matrices named `T_parent_child`. The convention is modified Denavit–Hartenberg (Craig, Introduction to Robotics,
3rd ed., eq. 3.6), with Hayati's angle beta between alpha and theta.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from rigs.schema.robot import Pose, Robot

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Mask = NDArray[np.bool_]
_UPRIGHT = 1e-13
"""Cosine of a pitch below which the pitch counts as 90°. The resulting error of the frame is not larger, in rad."""

RAIL_MM = 1000.0
"""Rail travel in mm for one unit of the column after the joints."""
_UPRIGHT_RAIL = 1e-3
"""Sine of the angle to the base's z axis below which a rail counts as vertical."""
_BLOCK = 1500
"""Samples per block. The data of all links then fit into the processor's cache: 0.9 of 1 MB."""


@dataclass(frozen=True)
class Arm:
    """Constants of an arm with `axes` joints.

    a, d: (axes,) mm. alpha, beta, offset: (axes,) rad. coupling: (axes, axes). drives (axes, axes): mechanics of the
    arm, the axes that each drive turns; None if these are the axes that its reported angle turns.
    T_world_base, T_flange_tool: (4, 4). limits: (axes, 2) rad. speed: (axes,) rad/s.
    rail (3,): direction in the world of a rail under the base, or None.

    Joint angles q (n, axes) rad of an arm on a rail may have an additional column with the rail position in m. In this
    unit a metre of travel moves the tool as far as a radian does one metre from the axis. The default position is 0.
    """

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
    rail: Array | None = None
    drives: Array | None = None

    @cached_property
    def by_drives(self) -> Arm:
        return self if self.drives is None else replace(self, coupling=self.drives, drives=None)

    @cached_property
    def to_drives(self) -> Array:
        """Matrix (axes, axes) that converts reported angles to angles of the drives."""
        return np.asarray(np.linalg.solve(self.by_drives.coupling, self.coupling))

    @property
    def axes(self) -> int:
        return len(self.a)

    @cached_property
    def links_at_zero(self) -> Array:
        """Transformations T(i-1,i) (axes, 4, 4) at theta = 0, which do not depend on the joint angles."""
        links = []
        for alpha, beta, a, d in zip(self.alpha, self.beta, self.a, self.d, strict=True):
            ca, sa = np.cos(alpha), np.sin(alpha)
            cb, sb = np.cos(beta), np.sin(beta)
            links.append(np.array([
                [cb, 0.0, sb, a + d * sb],
                [sa * sb, ca, -sa * cb, -d * sa * cb],
                [-ca * sb, sa, ca * cb, d * ca * cb],
                [0.0, 0.0, 0.0, 1.0],
            ]))  # fmt: skip
        return np.stack(links)


@lru_cache(maxsize=64)
def arm_of(robot: Robot) -> Arm:

    def column(field: str) -> Array:
        return np.array([getattr(axis, field) for axis in robot.axes], dtype=float)

    T_world_base, rail = transform(robot.base), None
    if robot.rail:
        rail = T_world_base[:3, :3] @ (np.array(robot.rail.direction) / np.linalg.norm(robot.rail.direction))
    coupling, drives = np.array(robot.coupling, dtype=float), np.array(robot.drive_ratios, dtype=float)
    return Arm(
        a=column("a_mm"),
        alpha=np.radians(column("alpha_deg")),
        beta=np.radians(column("beta_deg")),
        d=column("d_mm"),
        offset=np.radians(column("offset_deg")),
        coupling=coupling,
        T_world_base=T_world_base,
        T_flange_tool=transform(robot.tool),
        limits=np.radians(column("limits_deg")),
        speed=np.radians(column("speed_deg_s")),
        rail=rail,
        drives=None if np.array_equal(drives, coupling) else drives,
    )


def controller_robot(robot: Robot) -> Robot:
    if not robot.controller_axes:
        return robot
    constants = zip(robot.axes, robot.controller_axes, strict=True)
    axes = tuple(axis.model_copy(update=dict(own)) for axis, own in constants)
    return robot.model_copy(update={"axes": axes, "controller_axes": ()})


def controller_arm(robot: Robot) -> Arm:
    return arm_of(controller_robot(robot))


def drive_angles(arm: Arm, q: Array) -> Array:
    """Convert reported angles to those of the drives; a column with the rail position is kept."""
    return q if arm.drives is None else np.hstack([q[:, : arm.axes] @ arm.to_drives.T, q[:, arm.axes :]])


def reported_angles(arm: Arm, m: Array) -> Array:
    """Convert angles m (…, axes) of the drives, or changes of them, to reported angles in the same unit."""
    return m if arm.drives is None else np.asarray(m @ np.linalg.inv(arm.to_drives).T)


def without_setup(arm: Arm) -> Arm:
    """Arm with base and rail at the world origin, and the tool at the flange, from which fits start."""
    rail = None if arm.rail is None else arm.T_world_base[:3, :3].T @ arm.rail
    return replace(arm, T_world_base=np.eye(4), T_flange_tool=np.eye(4), rail=rail)


def rail_mm(arm: Arm, q: Array) -> Array:
    """Rail position (n,) mm in joint angles, 0 without a rail column."""
    stands: Array = RAIL_MM * q[:, arm.axes :].sum(axis=1)
    return stands


def base_places(arm: Arm, q: Array) -> Array:
    """Origin of the base in the world (n, 3) mm, including the rail."""
    at_zero: Array = arm.T_world_base[:3, 3]
    return np.broadcast_to(at_zero, (len(q), 3)) if arm.rail is None else at_zero + np.outer(rail_mm(arm, q), arm.rail)


def rail_frame(arm: Arm) -> Array:
    """Directions (3, 3) of a rail in the world as columns: along it, horizontal in the base frame and perpendicular to
    it (for a vertical rail the x axis of the base), and perpendicular to both.
    """
    assert arm.rail is not None  # noqa: S101 - asked for rails alone
    up = arm.T_world_base[:3, 2]
    across = np.cross(up, arm.rail)
    if np.linalg.norm(across) < _UPRIGHT_RAIL:
        across = arm.T_world_base[:3, 0]
    across = across / np.linalg.norm(across)
    return np.column_stack([arm.rail, across, np.cross(arm.rail, across)])


def transform(pose: Pose) -> Array:
    return transforms(np.array([*pose.xyz_mm, *pose.rpy_deg]))


def transforms(poses: Array) -> Array:
    """Frames (..., 4, 4) of poses (..., 6) in mm and degrees.

    Roll, pitch and yaw are about fixed axes: R = Rz(yaw) Ry(pitch) Rx(roll).
    """
    angles = np.radians(np.moveaxis(poses[..., 3:], -1, 0))
    (cr, cp, cy), (sr, sp, sy) = np.cos(angles), np.sin(angles)
    T = np.zeros((*poses.shape[:-1], 4, 4))
    rows = (
        (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        (-sp, cp * sr, cp * cr),
    )
    for k, row in enumerate(rows):
        T[..., k, :3] = np.stack(row, axis=-1)
    T[..., :3, 3], T[..., 3, 3] = poses[..., :3], 1.0
    return T


def rotation(turn: Array) -> Array:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3) rad, by Rodrigues' formula.

    scipy has this too, but its import takes half a second, a quarter of a small command.
    """
    angle = np.linalg.norm(turn, axis=-1)[..., None, None]
    K = np.cross(np.eye(3), turn[..., None, :])
    half = 0.5 * np.sinc(angle / (2 * np.pi)) ** 2
    return np.asarray(np.eye(3) + np.sinc(angle / np.pi) * K + half * (K @ K))


def roll_pitch_yaw(T: Array) -> Array:
    """Fixed-axis roll, pitch and yaw (..., 3) rad of frames: the inverse of `transform`.

    At a pitch of 90° roll and yaw have a common axis, and roll is set to zero.
    """
    R = np.moveaxis(T[..., :3, :3], (-2, -1), (0, 1))
    upright = np.hypot(R[0, 0], R[1, 0]) < _UPRIGHT
    yaw = np.where(upright, np.arctan2(-R[0, 1], R[1, 1]), np.arctan2(R[1, 0], R[0, 0]))
    # Near a pitch of 90° yaw is inaccurate. The roll is computed after removing yaw, which compensates for the error.
    c, s = np.cos(yaw), np.sin(yaw)
    pitch = np.arctan2(-R[2, 0], c * R[0, 0] + s * R[1, 0])
    roll = np.arctan2(s * R[0, 2] - c * R[1, 2], c * R[1, 1] - s * R[0, 1])
    return np.stack([roll, pitch, yaw], axis=-1)


def link_frames(arm: Arm, q: Array) -> Array:
    """T_world_link of all joints for joint angles q (n, axes) rad: (n, axes, 4, 4)."""
    T = np.empty((len(q), arm.axes, 4, 4))
    for block in blocks(len(q)):
        for axis, columns in enumerate(link_columns(arm, q[block])):
            _set_frames(T[block, axis], columns)
    return T


def forward(arm: Arm, q: Array) -> Array:
    """T_world_tool (n, 4, 4) in mm for joint angles q (n, axes) rad."""
    T = np.empty((len(q), 4, 4))
    for block in blocks(len(q)):
        _set_frames(T[block], tool_columns(arm, q[block]))
    return T


def forward_and_jacobian(arm: Arm, q: Array) -> tuple[Array, Array]:
    """T_world_tool (n, 4, 4) and the geometric Jacobian of the tool origin (n, 6, axes), in mm/rad and rad/rad in the
    world, by the joints of the controller.
    """
    T, J = np.empty((len(q), 4, 4)), np.empty((len(q), 6, arm.axes))
    for block in blocks(len(q)):
        tool, motions = tool_and_motions(arm, q[block])
        _set_frames(T[block], tool)
        J[block] = motions.transpose(2, 1, 0)
    return T, J


def tool_and_motions(arm: Arm, q: Array) -> tuple[Array, Array]:
    """Columns (4, 3, n) of T_world_tool, and the transposed Jacobian (axes, 6, n), for one block."""
    links = list(link_columns(arm, q))
    tool = _at(links[-1], arm.T_flange_tool)
    per_theta = np.empty((arm.axes, 6, tool.shape[2]))
    for motion, link in zip(per_theta, links, strict=True):
        motion[:3] = _cross(link[2], tool[3] - link[3])
        motion[3:] = link[2]
    return tool, (arm.coupling.T @ per_theta.reshape(arm.axes, -1)).reshape(per_theta.shape)


def _cross(a: Array, b: Array) -> tuple[Array, Array, Array]:
    (ax, ay, az), (bx, by, bz) = a, b
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


def blocks(count: int, size: int = _BLOCK) -> Iterator[slice]:
    """Slices that cover `count` samples. At most `size` samples per slice fit into the processor's cache."""
    return (slice(at, min(at + size, count)) for at in range(0, count, size))


def tool_columns(arm: Arm, q: Array) -> Array:
    """Columns x, y, z and origin of T_world_tool, (4, 3, n), for a block."""
    *_, flange = link_columns(arm, q)
    return _at(flange, arm.T_flange_tool)


def link_columns(arm: Arm, q: Array) -> Iterator[Array]:
    """Columns x, y, z and origin of each joint frame, (4, 3, n), for a block.

    Samples are last, so that each step of the chain is a single operation on long rows.
    """
    cosine, sine = cos_sin(arm.coupling @ q[:, : arm.axes].T + arm.offset[:, None])
    before: Array = np.broadcast_to(arm.T_world_base[:3].T[:, :, None], (4, 3, len(q)))
    if arm.rail is not None and q.shape[1] > arm.axes:
        before = before.copy()
        before[3] += arm.rail[:, None] * rail_mm(arm, q)
    for at_zero, c, s in zip(arm.links_at_zero, cosine, sine, strict=True):
        before = _at(before, at_zero)
        x, y = before[0].copy(), before[1]
        before[0] *= c
        before[0] += s * y
        before[1] = c * y - s * x
        yield before


def cos_sin(angle: Array) -> tuple[Array, Array]:
    """Cosine and sine of angles (n, …) rad, accurate to 3e-16.

    From the tangent of the half angle, which numpy vectorises: 2 ns for both instead of 16 ns.
    """
    tangent = np.tan(angle / 2)
    square = tangent * tangent
    cosine, sine = 1 - square, 2 * tangent
    square += 1
    cosine /= square
    sine /= square
    return cosine, sine


def _at(columns: Array, T: Array) -> Array:
    return (T.T @ columns.reshape(4, -1)).reshape(columns.shape)


def _set_frames(T: Array, columns: Array) -> None:
    T[:, :3] = columns.transpose(2, 1, 0)
    T[:, 3] = (0.0, 0.0, 0.0, 1.0)


def columns_of(T: Array) -> Array:
    return np.ascontiguousarray(T[:, :3].transpose(2, 1, 0))


def pose_error(T: Array, target: Array) -> Array:
    """Small motion from T to target in the world, (n, 6): translation in mm, and rotation vector in rad."""
    return column_error(columns_of(T), columns_of(target)).T


def column_error(columns: Array, target: Array) -> Array:
    """Small motion (6, n) between frames given as columns (4, 3, n), in mm and rad."""
    error = np.empty((6, columns.shape[2]))
    error[:3] = target[3] - columns[3]
    # The rotation axis times the sine is half the sum of the cross products of corresponding columns.
    skew = np.sum([_cross(old, new) for old, new in zip(columns[:3], target[:3], strict=True)], axis=0) / 2
    # The sine alone would vanish at half a turn. With the full angle, Newton's direction is correct.
    sine = np.sqrt((skew * skew).sum(axis=0))
    angle = np.arctan2(sine, ((columns[:3] * target[:3]).sum(axis=(0, 1)) - 1) / 2)
    error[3:] = skew * (angle / np.where(sine > 1e-12, sine, 1.0) + (sine <= 1e-12))
    return error
