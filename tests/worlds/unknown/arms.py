"""Arms in standard Denavit-Hartenberg parameters (Hartenberg and Denavit 1955), mm and rad, with gravity torques.

T = base, then for each joint Rz(theta) Tz(d) Tx(a) Rx(alpha), then the tool. An imperfect arm has additional small
motions (twists: three translations in mm, three rotations in rad) before and after each joint.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

GRAVITY_M_S2 = 9.80665
PITCH_TOLERANCE_MM = 1e-9
IK_ARM_MM = 400.0
"""Lever arm that makes rotations comparable with translations in the inverse kinematics."""


class UnreachableError(Exception):
    """The inverse kinematics found no solution."""


@dataclass(frozen=True)
class Arm:
    """A serial arm. a, d (axes,) mm; alpha, zero (axes,) rad; mass (axes,) kg; centre (axes, 3) mm in the frame
    after each row of the table; low, high (axes,) rad: ranges of random poses; build: key of the rig file.
    """

    name: str
    build: str
    a: Array
    alpha: Array
    d: Array
    zero: Array
    mass: Array
    centre: Array
    low: Array
    high: Array
    payload_kg: float = 0.0

    @property
    def axes(self) -> int:
        return len(self.a)


@dataclass(frozen=True)
class Deviation:
    """Deviations of the links from the reported joint angles at n times.

    joint (n, axes) rad; before, after (n, axes, 6): twists in the frame before and after each joint; tool (n, 3) mm:
    displacement of the measured point in the flange frame; gauge (n, 2) mm: errors of the ball link.
    """

    joint: Array
    before: Array
    after: Array
    tool: Array
    gauge: Array

    def __add__(self, other: Deviation) -> Deviation:
        return Deviation(*map(np.add, vars(self).values(), vars(other).values()))

    def take(self, rows: NDArray[np.int64]) -> Deviation:
        """Deviations at selected times."""
        return Deviation(*(part[rows] for part in vars(self).values()))


def no_deviation(count: int, axes: int) -> Deviation:
    """Deviations of a perfect arm."""
    twist = np.zeros((count, axes, 6))
    return Deviation(np.zeros((count, axes)), twist, twist.copy(), np.zeros((count, 3)), np.zeros((count, 2)))


@dataclass(frozen=True)
class Chain:
    """Postures. flange (n, 4, 4); origin, axis (n, axes, 3): a point on each joint axis and its direction; link
    (n, axes, 4, 4): the frame after each joint."""

    flange: Array
    origin: Array
    axis: Array
    link: Array


def forward(arm: Arm, q: Array, deviation: Deviation | None = None) -> Chain:
    """Compute the flange and all joint frames of postures q (n, axes) rad."""
    theta = q + arm.zero
    if deviation is not None:
        theta = theta + deviation.joint
    T = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    origin, axis, link = [], [], []
    for k in range(arm.axes):
        if deviation is not None:
            T = T @ small_motion(deviation.before[:, k])
        origin.append(T[:, :3, 3])
        axis.append(T[:, :3, 2])
        T = T @ _row(theta[:, k], arm.d[k], arm.a[k], arm.alpha[k])
        if deviation is not None:
            T = T @ small_motion(deviation.after[:, k])
        link.append(T)
    return Chain(T, np.stack(origin, axis=1), np.stack(axis, axis=1), np.stack(link, axis=1))


def _row(theta: Array, d: float, a: float, alpha: float) -> Array:
    """Return Rz(theta) Tz(d) Tx(a) Rx(alpha) (n, 4, 4)."""
    c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
    T = np.zeros((len(theta), 4, 4))
    T[:, 0] = np.stack([c, -s * ca, s * sa, a * c], axis=1)
    T[:, 1] = np.stack([s, c * ca, -c * sa, a * s], axis=1)
    T[:, 2] = [0.0, sa, ca, d]
    T[:, 3, 3] = 1.0
    return T


def small_motion(twist: Array) -> Array:
    """Transforms (n, 4, 4) of small twists (n, 6)."""
    T = np.tile(np.eye(4), (len(twist), 1, 1))
    T[:, :3, :3], T[:, :3, 3] = Rotation.from_rotvec(twist[:, 3:]).as_matrix(), twist[:, :3]
    return T


def point(flange: Array, offset: Array) -> Array:
    """Return positions (n, 3) of points fixed to the flange: offset (3,) or (n, 3) mm."""
    offsets = np.broadcast_to(offset, (len(flange), 3))
    return np.einsum("nij,nj->ni", flange[:, :3, :3], offsets) + flange[:, :3, 3]


def gravity_torque(arm: Arm, q: Array) -> Array:
    """Compute the torque of gravity (n, axes) Nm about each joint, with the payload at the flange."""
    chain = forward(arm, q)
    torque = np.zeros_like(q)
    bodies = [(arm.mass[k], k, point(chain.link[:, k], arm.centre[k])) for k in range(arm.axes)]
    bodies.append((arm.payload_kg, arm.axes - 1, chain.flange[:, :3, 3]))
    for mass, last, where in bodies:
        weight = np.array([0.0, 0.0, -mass * GRAVITY_M_S2])
        for k in range(last + 1):
            moment = np.cross(where - chain.origin[:, k], weight) / 1000.0
            torque[:, k] += np.einsum("ni,ni->n", moment, chain.axis[:, k])
    return torque


def inverse(arm: Arm, target: Array, offset: Array, q: Array, rounds: int = 60) -> Array:
    """Find joint angles (n, axes) for tool frames target (n, 4, 4), by damped Newton steps from q.

    offset (4, 4): tool in the flange frame. Raises UnreachableError if a target is missed.
    """
    for _ in range(rounds):
        chain = forward(arm, q)
        tool = chain.flange @ offset
        error = pose_error(tool, target)
        if np.abs(error).max() < PITCH_TOLERANCE_MM:
            return q
        lever = np.cross(chain.axis, tool[:, None, :3, 3] - chain.origin)
        jacobian = np.concatenate([lever, IK_ARM_MM * chain.axis], axis=2)
        normal = np.einsum("nki,nkj->nij", jacobian, jacobian) + 1e-6 * np.eye(6)
        step = np.einsum("nki,ni->nk", jacobian, np.linalg.solve(normal, error[:, :, None])[:, :, 0])
        q = q + step * np.minimum(1.0, 0.3 / np.maximum(np.abs(step).max(axis=1, keepdims=True), 1e-12))
    if np.abs(pose_error(forward(arm, q).flange @ offset, target)).max() > 1e-5:
        raise UnreachableError
    return q


def pose_error(now: Array, wanted: Array) -> Array:
    """Error (n, 6) of poses: translation, and rotation times IK_ARM_MM."""
    rotation = Rotation.from_matrix(wanted[:, :3, :3] @ now[:, :3, :3].swapaxes(1, 2)).as_rotvec()
    return np.concatenate([wanted[:, :3, 3] - now[:, :3, 3], IK_ARM_MM * rotation], axis=1)


# --- the arms


def _arm(
    name: str,
    build: str,
    rows: Sequence[tuple[float, float, float]],
    ranges: Sequence[tuple[float, float]],
    mass: Sequence[float],
    centre: Sequence[Sequence[float]],
) -> Arm:
    """Create an arm from rows (d, a, alpha in degrees) and joint ranges (degrees) for random poses."""
    d, a, alpha = np.array(rows, dtype=float).T
    low, high = np.radians(np.array(ranges, dtype=float)).T
    zero = np.zeros(len(rows))
    return Arm(name, build, a, np.radians(alpha), d, zero, np.array(mass), np.array(centre, dtype=float), low, high)


def ur10e() -> Arm:
    """A Universal Robots UR10e: DH parameters, masses and centres of mass published by the maker (article
    17264).
    """
    rows = [(180.7, 0, 90), (0, -612.7, 0), (0, -571.55, 0), (174.15, 0, 90), (119.85, 0, -90), (116.55, 0, 0)]
    ranges = [(-90, 90), (-135, -45), (50, 130), (-125, -35), (-115, -50), (-150, 150)]
    centre = [[21, 0, 27], [380, 0, 158], [240, 0, 68], [0, 7, 18], [0, 7, 18], [0, 0, -26]]
    mass = [7.369, 13.051, 3.989, 2.1, 1.98, 0.615]
    return _arm("UR10e", "light", rows, ranges, mass, centre)


def elbow_arm() -> Arm:
    """An industrial six-axis arm with the lengths of a KUKA KR 10 R1100 (data sheet: 25, 560, 35, 515, 80 mm).

    Link masses of such arms are not published; the 55 kg of the data sheet are distributed over the links.
    """
    rows = [(400, 25, -90), (0, 560, 0), (0, 35, -90), (515, 0, 90), (0, 0, -90), (80, 0, 0)]
    ranges = [(-80, 80), (-110, -50), (-30, 50), (-120, 120), (25, 100), (-150, 150)]
    centre = [[-25, 40, 10], [-300, 0, 60], [-20, 20, -30], [0, -150, 0], [0, 0, 20], [0, 0, -15]]
    mass = [16.0, 14.0, 8.0, 5.0, 2.0, 0.5]
    return _arm("elbow arm", "industrial", rows, ranges, mass, centre)


def seven_axis_arm() -> Arm:
    """A seven-axis arm with the lengths of a KUKA LBR iiwa 14 (data sheet: 360, 420, 400, 126 mm; 29.9 kg)."""
    rows = [(360, 0, -90), (0, 0, 90), (420, 0, 90), (0, 0, -90), (400, 0, -90), (0, 0, 90), (126, 0, 0)]
    ranges = [(-80, 80), (5, 60), (-60, 60), (-110, -40), (-90, 90), (20, 90), (-150, 150)]
    centre = [[0, 0, 60], [0, 60, 40], [0, -60, 0], [0, -60, 40], [0, 0, 60], [0, 0, 0], [0, 0, -20]]
    mass = [6.0, 6.0, 4.0, 4.0, 3.0, 2.0, 0.5]
    return _arm("seven-axis arm", "torque_sensing", rows, ranges, mass, centre)
