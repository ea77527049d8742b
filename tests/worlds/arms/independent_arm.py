"""Arms with errors measured by a tracker, and an ordinary least-squares calibration. Nothing here is imported from rig.

The kinematics use the constants of a shipped rig file. Each arm has typical errors of a healthy arm (link constants,
gear waves of orders 1 and 2) and optionally large errors of the zeros or of all constants. The reference calibration is
scipy's Levenberg-Marquardt for the same constants, the tracker frame and the tool.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

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


def constants_of(name: str) -> Constants:
    robot = yaml.safe_load((RIGS / f"{name}.yaml").read_text(encoding="utf-8"))["robot"]
    value = {
        key: np.array([axis.get(key, 0.0) for axis in robot["axes"]], dtype=float)
        for key in ("a_mm", "alpha_deg", "d_mm", "offset_deg")
    }
    coupling = np.array(robot.get("coupling", np.eye(6)), dtype=float)
    return Constants(
        value["a_mm"], np.radians(value["alpha_deg"]), value["d_mm"], np.radians(value["offset_deg"]), coupling
    )


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


NAMES = {"joint_offset": ("offset",), "joint_offset,link_geometry": ("offset", "a", "alpha", "d")}
_UNIT = {"offset": 1e-3, "alpha": 1e-3, "a": 1.0, "d": 1.0}


@dataclass(frozen=True)
class Peer:
    """Result of least squares: constants, and the tracker frame and tool of the poses (9,)."""

    wrong: Wrong
    frame: Array

    def held_out_mm(self, arm: Constants, poses: Seen, *, again: bool) -> float:
        """Rms distance; again: fit frame and tool to these poses first, as for a new placement."""
        frame = _framed(arm, self.wrong, poses) if again else self.frame
        left = _placed(arm, self.wrong, frame, poses.q) - poses.xyz_mm
        return float(np.sqrt((left**2).sum(axis=1).mean()))


def least_squares_fit(arm: Constants, poses: Seen, fit: str) -> Peer:
    """Fit constants and frame by Levenberg-Marquardt with equal weights of all poses."""
    names = NAMES[fit]
    right = none()

    def parts(x: Array) -> tuple[Wrong, Array]:
        values = {name: x[6 * k : 6 * k + 6] * _UNIT[name] for k, name in enumerate(names)}
        return Wrong(**({key: getattr(right, key) for key in right.__dataclass_fields__} | values)), x[6 * len(names) :]

    def left(x: Array) -> Array:
        wrong, frame = parts(x)
        return (_placed(arm, wrong, frame, poses.q) - poses.xyz_mm).ravel()

    start = np.concatenate([np.zeros(6 * len(names)), _framed(arm, right, poses)])
    found = least_squares(left, start, method="lm" if poses.xyz_mm.size >= len(start) else "trf")
    return Peer(*parts(found.x))


def _placed(arm: Constants, wrong: Wrong, frame: Array, q: Array) -> Array:
    """Return target positions. frame (9,): rotation vector times 1000, position in mm, tool in mm."""
    R, p = flange(arm, wrong, q)
    moved: Array = (p + R @ frame[6:]) @ Rotation.from_rotvec(frame[:3] / 1e3).as_matrix().T + frame[3:6]
    return moved


def _framed(arm: Constants, wrong: Wrong, poses: Seen) -> Array:
    R, p = flange(arm, wrong, poses.q)
    tool, start = np.zeros(3), np.zeros(9)
    for _ in range(30):
        points = p + R @ tool
        turn, _ = Rotation.align_vectors(poses.xyz_mm - poses.xyz_mm.mean(axis=0), points - points.mean(axis=0))
        M = turn.as_matrix()
        place = poses.xyz_mm.mean(axis=0) - points.mean(axis=0) @ M.T
        A = np.concatenate([M @ R, np.tile(np.eye(3), (len(p), 1, 1))], axis=2).reshape(-1, 6)
        tool = np.linalg.lstsq(A, (poses.xyz_mm - p @ M.T).ravel(), rcond=None)[0][:3]
        start = np.concatenate([1e3 * turn.as_rotvec(), place, tool])
    found: Array = np.asarray(
        least_squares(
            lambda x: (_placed(arm, wrong, x, poses.q) - poses.xyz_mm).ravel(),
            start,
            method="lm",
        ).x
    )
    return found
