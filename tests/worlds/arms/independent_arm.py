"""Arms with errors measured by a tracker. Nothing here is imported from rig.

The kinematics use the constants of a shipped rig file. Each arm has typical errors of a healthy arm (link constants,
gear waves of orders 1 and 2) and optionally large errors of the zeros or of all constants.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tests.support.shipped_cells import cell_name
from tests.worlds.chain import link_frames

Array = NDArray[np.float64]
RIGS = Path(__file__).parents[3] / "rigs"
HEALTHY = {"offset": np.radians(0.02), "a": 0.2, "alpha": np.radians(0.02), "d": 0.2}
GEAR_RAD = np.radians(0.005)
NOISE_MM = (0.008, 0.050)
"""Range of the standard deviation of a coordinate of a tracker pose."""
POSTURE_DEG = {"paper-fanuc": (0, 20, 10, 0, 60, 0), "ur10e": (0, -80, 100, -20, 80, 0)}


@dataclass(frozen=True)
class Constants:
    """Modified Denavit-Hartenberg parameters (6,) in mm and rad, and the coupling (6, 6) of the reported angles."""

    a: Array
    alpha: Array
    d: Array
    offset: Array
    coupling: Array


@dataclass(frozen=True)
class Wrong:
    """Errors of an arm in rad and mm, each (6,), and sine and cosine (6, 2) rad of gear waves of orders 1 and 2."""

    offset: Array
    a: Array
    alpha: Array
    d: Array
    sine: Array
    cosine: Array


def constants_from(robot: Mapping[str, Any]) -> Constants:
    """Constants of the section `robot` of a rig file."""
    keys = ("a_mm", "alpha_deg", "d_mm", "offset_deg")
    a, alpha, d, offset = np.array([[axis.get(key, 0.0) for key in keys] for axis in robot["axes"]], dtype=float).T
    coupling = np.array(robot.get("coupling", np.eye(6)), dtype=float)
    return Constants(a, np.radians(alpha), d, np.radians(offset), coupling)


@cache
def constants_of(name: str) -> Constants:
    return constants_from(yaml.safe_load((RIGS / f"{cell_name(name)}.yaml").read_text(encoding="utf-8"))["robot"])


def flange(arm: Constants, wrong: Wrong, q: Array) -> tuple[Array, Array]:
    """Return rotation (n, 3, 3) and position (n, 3) mm of the flange at reported angles q (n, 6) rad.

    Each motor turns its own axis, also if the displayed angles are coupled.
    """
    senses = np.diag(arm.coupling)
    motor = q @ arm.coupling.T / senses
    link = motor + wrong.offset
    for order in (1, 2):
        link = link + wrong.sine[:, order - 1] * np.sin(order * motor)
        link = link + wrong.cosine[:, order - 1] * np.cos(order * motor)
    theta = link * senses + arm.offset
    R, p = link_frames(arm.a + wrong.a, arm.alpha + wrong.alpha, 0.0, arm.d + wrong.d, theta)
    return R[:, -1], p[:, -1]


def none() -> Wrong:
    """An arm without errors."""
    return Wrong(*(np.zeros(6) for _ in range(4)), np.zeros((6, 2)), np.zeros((6, 2)))


def healthy(rng: np.random.Generator) -> Wrong:
    return Wrong(
        *(rng.normal(0, HEALTHY[key], 6) for key in ("offset", "a", "alpha", "d")),
        *rng.normal(0, GEAR_RAD / np.sqrt(2), (2, 6, 2)),
    )


def bad_zeros(rng: np.random.Generator) -> Wrong:
    """Return errors of 0.2 to 0.6 degrees of every zero, and healthy values otherwise."""
    wrong = healthy(rng)
    wrong.offset[:] = np.radians(rng.uniform(0.2, 0.6, 6)) * rng.choice([-1, 1], 6)
    return wrong


def bad_arm(rng: np.random.Generator) -> Wrong:
    """Return errors as `bad_zeros`, and errors of 0.5 to 2 mm of the lengths and 0.05 to 0.2 degrees of the twists."""
    wrong = bad_zeros(rng)
    for length in (wrong.a, wrong.d):
        length[:] = rng.uniform(0.5, 2.0, 6) * rng.choice([-1, 1], 6)
    wrong.alpha[:] = np.radians(rng.uniform(0.05, 0.2, 6)) * rng.choice([-1, 1], 6)
    return wrong


@dataclass(frozen=True)
class Seen:
    """Poses q (n, 6) rad, and target positions xyz_mm (n, 3) measured by the tracker."""

    q: Array
    xyz_mm: Array


@dataclass(frozen=True)
class Cell:
    """An arm, the place of its tracker (rotation vector, mm), and the target on the flange (mm)."""

    arm: Constants
    wrong: Wrong
    turn: Array
    place_mm: Array
    tool_mm: Array
    noise_mm: float

    def seen(self, q: Array, rng: np.random.Generator, *, wild: float = 0.0) -> Seen:
        """Measure poses with the tracker. A share `wild` of them has errors of 10 to 100 sigma."""
        R, p = flange(self.arm, self.wrong, q)
        xyz = (p + R @ self.tool_mm) @ Rotation.from_rotvec(self.turn).as_matrix().T + self.place_mm
        noise = rng.normal(0, self.noise_mm, xyz.shape)
        far = rng.random(len(q)) < wild
        away = rng.normal(size=(len(q), 3))
        away *= (rng.uniform(10, 100, len(q)) * self.noise_mm / np.linalg.norm(away, axis=1))[:, None]
        return Seen(q, xyz + noise + away * far[:, None])


def cell(name: str, wrong: Wrong, rng: np.random.Generator) -> Cell:
    noise = float(np.exp(rng.uniform(*np.log(NOISE_MM))))
    turn = Rotation.from_euler("xyz", [rng.uniform(-0.05, 0.05), rng.uniform(-0.05, 0.05), rng.uniform(-3, 3)])
    return Cell(
        constants_of(name),
        wrong,
        turn.as_rotvec(),
        rng.uniform(-3000, 3000, 3),
        rng.uniform([-80, -80, 60], [80, 80, 300]),
        noise,
    )


def postures(name: str, count: int, rng: np.random.Generator, half_deg: tuple[float, ...] = ()) -> Array:
    """Return random joint angles (count, 6) rad around the posture of the rig."""
    half = np.array(half_deg or (90, 35, 35, 90, 45, 120), dtype=float)
    return np.radians(np.array(POSTURE_DEG[name]) + rng.uniform(-half, half, (count, 6)))
