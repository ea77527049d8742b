"""An independently simulated arm on a compliant stand: forward kinematics, weights, columns and anchors.

It shares no code with the model of rig. A column is a cantilever on anchors. Under the moment M of the arm's weight at
the top, its end turns by M L / EI and moves by M L² / 2 EI (Timoshenko, Strength of Materials), and the anchors turn it
about its foot. A guide next to the arm also lets it sag.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigs.schema.robot import Robot
from tests.worlds.arms.seven_axes import Array, Truth
from tests.worlds.chain import G_M_S2, link_frames


@dataclass(frozen=True)
class Stand:
    """A column with a height (mm), compliances (rad/Nm) about its soft and its stiff axis, and the angle (rad) of
    the soft axis from the x axis of the base. anchors: rad/Nm, about the foot; sag: mm/Nm of the moment about the
    soft axis; firmer: relative increase of the stiffness at 200 Nm.
    """

    height_mm: float = 600.0
    soft: float = 0.0
    stiff: float = 0.0
    turned: float = 0.0
    anchors: float = 0.0
    sag: float = 0.0
    firmer: float = 0.0

    def moved(self, places: Array, moment: Array) -> Array:
        """Return places (n, 3) mm displaced by moments (n, 2) Nm about x and y at the top of the stand."""
        c, s = np.cos(self.turned), np.sin(self.turned)
        axes = np.array([[c, s, 0.0], [-s, c, 0.0]])
        about = moment @ axes[:, :2].T
        about = about / (1 + self.firmer * np.linalg.norm(about, axis=1, keepdims=True) / 200)
        bent = (about * [self.soft, self.stiff]) @ axes
        tipped = self.anchors * about @ axes
        up = np.array([0.0, 0.0, 1.0])
        top = np.cross(bent, up) * self.height_mm / 2 + np.cross(tipped, up) * self.height_mm
        turned = np.array([turn(v, p) for v, p in zip(bent + tipped, places, strict=True)])
        return np.asarray(turned + top + np.outer(self.sag * about[:, 0], up))


def turn(v: Array, p: Array) -> Array:
    """Rotate a point p (3,) about the origin by a rotation vector v (3,) (Rodrigues)."""
    angle = float(np.linalg.norm(v))
    if angle == 0:
        return p
    k = v / angle
    return np.asarray(
        p * np.cos(angle) + np.cross(k, p) * np.sin(angle) + k * (k @ p) * (1 - np.cos(angle)), dtype=float
    )


def _base(robot: Robot) -> Array:
    """Base frame (4, 4) with rotations about the fixed x, y and z axes in this order."""
    T = np.eye(4)
    for k, angle in enumerate(np.radians(robot.base.rpy_deg)):
        T[:3, :3] = np.array([turn(angle * np.eye(3)[k], column) for column in T[:3, :3].T]).T
    return T


def frames(truth: Truth, robot: Robot, theta: Array) -> Array:
    """Link frames (axes, n, 4, 4) of an arm with the errors `truth.off`, relative to the origin of its
    base.
    """

    def of(key: str) -> Array:
        return np.array([getattr(axis, key) for axis in robot.axes], dtype=float)

    off = truth.off
    R, p = link_frames(
        of("a_mm") + off.a, np.radians(of("alpha_deg")) + off.alpha, 0.0, of("d_mm") + off.d,
        theta + np.radians(of("offset_deg")) + off.zero,
    )  # fmt: skip
    T = np.tile(np.eye(4), (*p.shape[:2], 1, 1))
    T[:, :, :3, :3], T[:, :, :3, 3] = R, p
    return np.asarray((_base(robot) @ T).swapaxes(0, 1))


def moment_nm(robot: Robot, links: Array) -> Array:
    """Moment (n, 2) Nm of links and payload about the x and y axes at the origin of the base."""
    total = np.zeros((links.shape[1], 2))
    weights = [(axis.mass_kg, np.append(axis.centre_mm, 1.0), k) for k, axis in enumerate(robot.axes)]
    for mass, centre, k in [*weights, (robot.payload_kg, np.array([0.0, 0.0, 0.0, 1.0]), len(robot.axes) - 1)]:
        at = links[k] @ centre / 1000
        total += mass * G_M_S2 * np.stack([-at[:, 1], at[:, 0]], axis=1)
    return total


@dataclass(frozen=True)
class OnStand:
    """An arm on a stand, with ball positions relative to the floor."""

    robot: Robot
    arm: Truth
    stand: Stand

    @property
    def scatter_mm(self) -> float:
        """Standard deviation of a coordinate of the arm, in mm."""
        return self.arm.scatter_mm

    def reported(self, q: Array) -> Array:
        """Angles (n, axes) rad reported by the arm."""
        return self.arm.reported(q)

    def places(self, q: Array, came_from: Array, ball_mm: Array) -> Array:
        """Positions (n, 3) mm of a ball at ball_mm on the tool."""
        theta = self.arm.link_q(q, came_from) @ np.array(self.robot.coupling).T
        links = frames(self.arm, self.robot, theta)
        bare = (links[-1] @ np.append(ball_mm, 1.0))[:, :3]
        return self.stand.moved(bare, moment_nm(self.robot, links))
