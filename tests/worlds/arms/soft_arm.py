"""Independently simulated arms with hidden constants, compliant joints and joint curves, and a tracker.

Errors are those of a healthy arm times 0.5 to 4. The waves are not periodic with a turn, and torques are summed link by
link.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tests.support.shipped_cells import cell_name
from tests.worlds.chain import gravity_torques, link_frames

Array = NDArray[np.float64]
RIGS = Path(__file__).parents[3] / "rigs"
LOW_DEG, HIGH_DEG = (-120, -130, -120, -150, -100, -170), (120, -20, 120, 150, 100, 170)
"""Range of the measured postures and of the test postures."""
NOISE_MM = 0.02
WAVES = 24
LENGTH_MM, ANGLE_DEG, WAVE_DEG = 0.2, 0.02, 0.005
SOFT_DEG_NM = (5e-5, 5e-5, 5e-5, 3e-4, 3e-4, 3e-4)
"""Compliance of a healthy arm."""


@dataclass(frozen=True)
class Arm:
    """Constants (6,) in mm and rad, tool (3,) mm; masses (7,) kg and centres (7, 3) mm in the frames of the links
    and finally of the flange; compliance (6,) rad/Nm; joint waves: amplitude, order and phase (6, w), rad.
    """

    a: Array
    alpha: Array
    beta: Array
    d: Array
    offset: Array
    tool: Array
    mass: Array
    centre: Array
    soft: Array
    wave: tuple[Array, Array, Array]

    def frames(self, q: Array) -> Array:
        """Frames (n, 6, 4, 4) of the links at joint angles q (n, 6) rad: modified Denavit-Hartenberg."""
        R, p = link_frames(self.a, self.alpha, self.beta, self.d, q + self.offset)
        T = np.tile(np.eye(4), (*p.shape[:2], 1, 1))
        T[:, :, :3, :3], T[:, :, :3, 3] = R, p
        return T

    def tool_mm(self, q: Array, point: Array | None = None) -> Array:
        """Positions (n, 3) mm of the tool, or of another point (3,) mm of the flange, at commanded angles
        q (n, 6) rad.
        """
        amplitude, order, phase = self.wave
        link = q + (amplitude * np.sin(order * q[:, :, None] + phase)).sum(axis=2)
        link = link + self.soft * self._torques(link)
        T = self.frames(link)[:, -1]
        return np.asarray(T[:, :3, :3] @ (self.tool if point is None else point) + T[:, :3, 3])

    def _torques(self, q: Array) -> Array:
        """Gravity torques (n, 6) Nm on each joint at joint angles q (n, 6) rad."""
        mass, centre = self.mass[:6].copy(), self.centre[:6].copy()
        mass[5] += self.mass[6]  # the payload hangs at the flange, the last link
        if mass[5]:
            centre[5] = self.mass[5:] @ self.centre[5:] / mass[5]
        return gravity_torques(*link_frames(self.a, self.alpha, self.beta, self.d, q + self.offset), mass, centre)


def nominal(name: str) -> Arm:
    """Arm of a shipped rig file."""
    robot = yaml.safe_load((RIGS / f"{cell_name(name)}.yaml").read_text(encoding="utf-8"))["robot"]

    def of(key: str) -> Array:
        return np.array([axis.get(key, 0.0) for axis in robot["axes"]], dtype=float)

    centre = np.array([axis.get("centre_mm", [0, 0, 0]) for axis in robot["axes"]] + [[0, 0, 0]], dtype=float)
    mass = np.append(of("mass_kg"), robot.get("payload_kg", 0.0))
    nothing = np.zeros(6)
    return Arm(
        of("a_mm"),
        np.radians(of("alpha_deg")),
        nothing,
        of("d_mm"),
        np.radians(of("offset_deg")),
        np.array(robot["tool"]["xyz_mm"], dtype=float),
        mass,
        centre,
        nothing,
        (np.zeros((6, 1)), np.ones((6, 1)), np.zeros((6, 1))),
    )


def wrong(arm: Arm, rng: np.random.Generator) -> Arm:
    def off(size: float | Array) -> Array:
        return np.asarray(rng.normal(0, 1, 6) * size * np.exp(rng.uniform(np.log(0.5), np.log(4), 6)))

    parallel = np.abs(np.sin(arm.alpha)) < 1e-3
    parallel[0] = False  # before axis 1 two twists would have the same effect
    k = np.arange(1, WAVES + 1)
    fall = k ** -rng.uniform(0.6, 1.5, (6, 1))
    amplitude = np.radians(np.abs(off(WAVE_DEG)))[:, None] * fall
    order = k + rng.uniform(-0.4, 0.4, (6, WAVES))
    return Arm(
        arm.a + off(LENGTH_MM),
        arm.alpha + np.radians(off(ANGLE_DEG)),
        np.radians(off(ANGLE_DEG)) * parallel,
        arm.d + off(LENGTH_MM),
        arm.offset + np.radians(off(ANGLE_DEG)),
        arm.tool,
        arm.mass * rng.uniform(0.9, 1.1, 7),
        arm.centre + rng.normal(0, 10, (7, 3)),
        np.radians(np.abs(off(np.array(SOFT_DEG_NM)))),
        (amplitude, order, rng.uniform(0, 2 * np.pi, (6, WAVES))),
    )


def seen(arm: Arm, rng: np.random.Generator, poses: int, twice: int) -> tuple[Array, Array]:
    """Return joint angles (n, 6) rad of poses and the measured positions (n, 3) mm.

    The first `twice` poses are measured again at the end.
    """
    q = np.radians(rng.uniform(LOW_DEG, HIGH_DEG, (poses, 6)))
    q = np.concatenate([q, q[:twice]])
    turn = Rotation.from_euler("xyz", [rng.uniform(-0.2, 0.2), rng.uniform(-0.2, 0.2), rng.uniform(-3, 3)])
    places = arm.tool_mm(q, rng.uniform([-60, -60, 40], [60, 60, 120]))
    return q, turn.apply(places) + rng.uniform(-3000, 3000, 3) + rng.normal(0, NOISE_MM, (len(q), 3))
