"""A Puma 560 with hidden faults, the gauges on its tool, and its error on a circle.

The constants are the modified Denavit-Hartenberg parameters of LinuxCNC's sample configuration puma560, in mm, with the
third joint on its nominal length. The gauges follow docs/conventions.md.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tests.worlds.chain import link_frames

Array = NDArray[np.float64]
A_MM = np.array([0.0, 0.0, 431.8, 0.0, 0.0, 0.0])
ALPHA_DEG = np.array([0.0, 90.0, 0.0, 90.0, -90.0, 90.0])
D_MM = np.array([671.8, -139.7, 0.0, 433.0, 0.0, 55.9])
HOME_DEG = np.array([0.0, -90.0, 90.0, 0.0, 0.0, 0.0])
"""Joint angles at which the motors stand at zero, HOME_OFFSET of the controller."""
TOOL_MM = np.array([20.0, -10.0, 150.0])
TOOL = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
"""Orientation of the tool on the flange: a turn by 90° about y."""


@dataclass(frozen=True)
class Faults:
    """Hidden faults. zero_deg, play_deg (6,): error of the zero and width of the play of each joint. gear_deg,
    gear_order (6,): amplitude of a wave of each gear, and its periods per turn of the joint. a_mm, d_mm (6,): errors of
    lengths.
    """

    zero_deg: Array = field(default_factory=lambda: np.zeros(6))
    play_deg: Array = field(default_factory=lambda: np.zeros(6))
    gear_deg: Array = field(default_factory=lambda: np.zeros(6))
    gear_order: Array = field(default_factory=lambda: np.ones(6))
    a_mm: Array = field(default_factory=lambda: np.zeros(6))
    d_mm: Array = field(default_factory=lambda: np.zeros(6))


@dataclass
class Arm:
    """The arm behind the motors. `_lag` (6,): position of each link in its play, in degrees."""

    faults: Faults
    _lag: Array | None = None

    def links(self, motors_deg: Array) -> Array:
        """Angles of the links (n, 6) in degrees at successive motor angles (n, 6) in degrees."""
        joints = motors_deg + HOME_DEG
        half = self.faults.play_deg / 2
        if self._lag is None:
            self._lag = joints[0].copy()
        loose = np.empty_like(joints)
        for k, row in enumerate(joints):  # the link rests until the motor has crossed the play
            self._lag = np.clip(self._lag, row - half, row + half)
            loose[k] = self._lag
        waves = self.faults.gear_deg * np.sin(self.faults.gear_order * np.radians(loose))
        return np.asarray(loose + waves + self.faults.zero_deg)

    def tool(self, links_deg: Array) -> tuple[Array, Array]:
        """Return rotation (n, 3, 3) and position (n, 3) mm of the tool."""
        return tool_at(links_deg, A_MM + self.faults.a_mm, D_MM + self.faults.d_mm)


def tool_at(joints_deg: Array, a_mm: Array = A_MM, d_mm: Array = D_MM) -> tuple[Array, Array]:
    """Return rotation (n, 3, 3) and position (n, 3) mm of the tool at angles (n, 6) in degrees."""
    R, p = link_frames(a_mm, np.radians(ALPHA_DEG), 0.0, d_mm, np.radians(joints_deg))
    return R[:, -1] @ TOOL, p[:, -1] + R[:, -1] @ TOOL_MM


@dataclass(frozen=True)
class SetUp:
    """Mounted ball and gauges: test, nominal centre (3,) mm and radius of the link, and place of the ball (3,) mm."""

    test: str
    centre_mm: Array
    radius_mm: float
    ball_mm: Array
    offsets_mm: tuple[float, float] = (25.0, -25.0)

    def readings(self, R: Array, p: Array) -> Array:
        """Readings (n, 2) mm of both gauges for tool frames."""
        to_ball = self.ball_mm - p
        distance = np.linalg.norm(to_ball, axis=1)
        if self.test not in ("yaw", "roll"):
            return np.stack([distance - self.radius_mm] * 2, axis=1)
        towards = to_ball / distance[:, None]
        z = np.einsum("nk,nk->n", towards, R[:, :, 2])
        e = np.einsum("nk,nk->n", towards, R[:, :, 1 if self.test == "yaw" else 0])
        return np.stack([((distance - self.radius_mm) - w * e) / z for w in self.offsets_mm], axis=1)


def circle_error_um(p: Array, centre_mm: Array, radius_mm: float) -> tuple[float, float]:
    """Rms distance in µm of tool positions (n, 3) mm from a horizontal circle, and the same if the place and
    tilt of the circle are taught with the robot."""
    away = p - centre_mm
    phi, height = np.arctan2(away[:, 1], away[:, 0]), away[:, 2]
    radial = np.hypot(away[:, 0], away[:, 1]) - radius_mm
    level = np.stack([np.cos(phi), np.sin(phi)], axis=1)
    tilted = np.column_stack([np.ones_like(phi), level])
    shape = radial - level @ np.linalg.lstsq(level, radial)[0]
    axial = height - tilted @ np.linalg.lstsq(tilted, height)[0]
    return tuple(1e3 * float(np.sqrt(np.mean(r**2 + h**2))) for r, h in ((radial, height), (shape, axial)))  # type: ignore[return-value]
