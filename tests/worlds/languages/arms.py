"""Arms for each dialect: the arm in the controller, which solves poses, and the real arm with errors.

The controller computes with the constants of the rig file (modified Denavit-Hartenberg, mm, rad), or with constants of
its own: a chain of six frames, as the maker of a Universal Robots arm stores them. Joint targets mean the pose of the
data sheet.
"""

from __future__ import annotations

import datetime as dt
import math
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgesv
from scipy.spatial.transform import Rotation

from analysis.robot.kinematics.arm import arm_of
from analysis.robot.kinematics.inverse import inverse
from rigs.effects import EffectProvenance, JointOffset, LinkGeometry, TransmissionError
from rigs.rig import Rig
from rigs.schema.robot import LinkConstants
from tests.worlds.arms.independent_arm import Constants, constants_from
from tests.worlds.interpreters.arms import rig_of
from tests.worlds.languages.own_constants import ur_constants, ur_frames

Array = NDArray[np.float64]
DIALECTS = ("ur", "kuka", "abb", "fanuc", "yaskawa")
RIGS = {
    "ur": "ur10e",
    "kuka": "kuka-kr-10-r1100-2",
    "abb": "abb-irb-120",
    "fanuc": "fanuc-m-10ia",
    "yaskawa": "yaskawa-gp7",
}
POSTURE_DEG = {
    "ur": (20, -80, 100, -40, 80, 20),
    "kuka": (20, -80, 90, 30, 60, -30),
    "abb": (20, 10, 20, 30, 60, 40),
    "fanuc": (20, 10, -20, 20, -60, 30),
    "yaskawa": (20, 10, -10, 20, -60, 30),
}
"""Middle of the generated targets: far from singularities, with every axis away from its zero."""
_ZEROS_DEG = (0.0, 0.06, -0.05, 0.07, -0.06, 0.04)
_EYE = np.eye(4)
_NEARLY_BACK = 0.9
"""Rotation steps near half a turn have no well-defined axis; such large steps are rare."""
_A3_MM, _GEAR_DEG = 0.4, 0.03
CONTROLLERS = ("data_sheet", "stated", "added", "unknown")
"""Constants of the controllers: of the data sheet, or their own, which the rig file states from the beginning, states
in addition to the axes of the data sheet, or does not state."""
_chosen = {"controller": "data_sheet"}
_FOUND = EffectProvenance(
    date=dt.date(2026, 11, 20), runs=("yaw-acw-001",), sd={"offset_deg": 1e-3, "delta": 0.01, "amplitude_deg": 5e-4}
)
_EXACT = 1e-5
"""Standard uncertainty of the differences from the data sheet, in mm or degrees: exact for a correction."""


def _found(key: str, u: float | None = None) -> EffectProvenance:
    return _FOUND.model_copy(update={"sd": {key: u or _FOUND.sd[key]}})


def choose_controller(kind: str) -> None:
    """Let the cells of all dialects have one of CONTROLLERS."""
    _chosen["controller"] = kind


@dataclass(frozen=True)
class Cell:
    """An arm with a rig file that states its errors.

    nominal: constants of the data sheet. links (6, 4, 4), offset (6,) rad: frames of the links in the controller at
    zero, and zeros of the links.
    """

    rig: Rig
    nominal: Constants
    links: Array
    offset: Array
    centre: Array
    limits: Array
    controller: str

    @cached_property
    def steps(self) -> list[list[float]]:
        """Frames of the links in the controller, each as twelve numbers by rows."""
        return self.links[:, :3].reshape(6, 12).tolist()

    @cached_property
    def sheet(self) -> Cell:
        """Cell with a controller that computes with the data sheet."""
        return replace(self, links=links_of(self.nominal), offset=self.nominal.offset, controller="data_sheet")

    def allows(self, q: Array) -> bool:
        """True if joint angles (6,) rad are within the limits."""
        return bool((q >= self.limits[:, 0]).all() and (q <= self.limits[:, 1]).all())

    def flanges(self, q: Array) -> Array:
        """Real flange frames (n, 4, 4) in the base at reported angles q (n, 6) rad."""
        errors = np.tile(np.radians(_ZEROS_DEG), (len(q), 1))
        errors[:, 0] += np.radians(_GEAR_DEG) * np.sin(2 * q[:, 0])
        motors = np.diag(self.nominal.coupling)  # Each motor sits in the joint that it turns.
        angles = q @ self.nominal.coupling.T + errors * motors + self.offset
        T = np.tile(np.eye(4), (len(q), 1, 1))
        for k, theta in enumerate(angles.T):
            step = self.links[k].copy()
            step[0, 3] += _A3_MM * (k == 2)
            turn = np.tile(np.eye(4), (len(q), 1, 1))
            turn[:, 0, 0] = turn[:, 1, 1] = np.cos(theta)
            turn[:, 1, 0] = np.sin(theta)
            turn[:, 0, 1] = -turn[:, 1, 0]
            T = T @ step @ turn
        return T


def links_of(arm: Constants, beta: Array | None = None) -> Array:
    """Frames (6, 4, 4) of the links at zero; beta (6,) rad: Hayati's angle after alpha."""
    T = np.tile(np.eye(4), (6, 1, 1))
    for k in range(6):
        T[k, :3, :3] = Rotation.from_euler("XY", [arm.alpha[k], 0.0 if beta is None else beta[k]]).as_matrix()
        T[k, :3, 3] = [arm.a[k], 0.0, 0.0] + arm.d[k] * T[k, :3, 2]
    return T


def cell(dialect: str) -> Cell:
    return _cell(dialect, _chosen["controller"])


@lru_cache
def _cell(dialect: str, controller: str) -> Cell:
    rig = rig_of(RIGS[dialect])
    zeros = [
        JointOffset(axis=axis, offset_deg=deg, found=_found("offset_deg"))
        for axis, deg in enumerate(_ZEROS_DEG, start=1)
        if deg
    ]
    others = (
        LinkGeometry(axis=3, field="a", delta=_A3_MM, found=_found("delta")),
        TransmissionError(axis=1, order=2, amplitude_deg=_GEAR_DEG, phase_deg=0, found=_found("amplitude_deg")),
    )
    axes = rig.robot.axes
    nominal = constants_from(rig.robot.model_dump())
    limits = np.radians([axis.limits_deg for axis in axes])
    centre = np.radians(np.array(POSTURE_DEG[dialect], dtype=float))
    here = Cell(rig, nominal, links_of(nominal), nominal.offset, centre, limits, controller)
    if controller == "data_sheet":
        return replace(here, rig=rig.model_copy(update={"effects": (*zeros, *others)}))
    own, here = _own(here, dialect)
    effects = (*_differences(rig, own), *zeros, *others)
    if controller == "stated":
        rows = zip(axes, own, strict=True)
        new, effects = tuple(axis.model_copy(update=dict(row)) for axis, row in rows), (*zeros, *others)
        robot = rig.robot.model_copy(update={"controller": "constants", "axes": new})
    elif controller == "added":
        robot = rig.robot.model_copy(update={"controller": "constants", "controller_axes": own})
    else:
        robot = rig.robot.model_copy(update={"controller": "unknown"})
    return replace(here, rig=rig.model_copy(update={"robot": robot, "effects": effects}))


def _own(here: Cell, dialect: str) -> tuple[tuple[LinkConstants, ...], Cell]:
    """Return constants of a controller as the rig file has them, and the cell with this controller.

    A Universal Robots arm has those of a real arm. The others are drawn with the sizes of such arms.
    """
    if dialect == "ur":
        return ur_constants(here.rig.robot), replace(here, links=ur_frames(), offset=np.zeros(6))
    rng, arm = np.random.default_rng(sum(map(ord, dialect))), here.nominal
    a, d = (arm.a + rng.normal(0, 0.3, 6)).round(4), (arm.d + rng.normal(0, 0.3, 6)).round(4)
    alpha = (np.degrees(arm.alpha) + rng.normal(0, 0.1, 6)).round(5)
    beta, offset = rng.normal(0, 0.05, 6).round(5), (np.degrees(arm.offset) + rng.normal(0, 0.01, 6)).round(5)
    own = tuple(
        LinkConstants(a_mm=row[0], alpha_deg=row[1], beta_deg=row[2], d_mm=row[3], offset_deg=row[4])
        for row in np.column_stack([a, alpha, beta, d, offset]).tolist()
    )
    constants = Constants(a, np.radians(alpha), d, np.radians(offset), arm.coupling)
    return own, replace(here, links=links_of(constants, np.radians(beta)), offset=constants.offset)


def _differences(rig: Rig, own: tuple[LinkConstants, ...]) -> list[LinkGeometry | JointOffset]:
    """Effects that turn the axes of the data sheet into others."""
    effects: list[LinkGeometry | JointOffset] = []
    turns = np.array([row.offset_deg - axis.offset_deg for row, axis in zip(own, rig.robot.axes, strict=True)])
    for k, deg in enumerate((turns / np.diag(rig.robot.coupling)).tolist(), start=1):
        effects.append(JointOffset(axis=k, offset_deg=deg, found=_found("offset_deg", _EXACT)))
    for k, (row, axis) in enumerate(zip(own, rig.robot.axes, strict=True), start=1):
        for field in ("a_mm", "alpha_deg", "beta_deg", "d_mm"):
            delta, found = getattr(row, field) - getattr(axis, field), _found("delta", _EXACT)
            effects.append(LinkGeometry(axis=k, field=field.split("_")[0], delta=delta, found=found))
    return [effect for effect in effects if abs(effect.model_dump().get("delta", 1.0)) > _EXACT]


def _walked(here: Cell, q: Array) -> list[tuple[float, ...]]:
    """Frames of the six links at q (6,) rad, each as twelve numbers by columns: three axes, position.

    Plain floats are five times as fast as products of small arrays, and a trial needs thousands per program.
    """
    xx, xy, xz, yx, yy, yz, zx, zy, zz, px, py, pz = 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0
    frames = []
    theta = (here.nominal.coupling @ q + here.offset).tolist()
    for (ax, bx, cx, tx, ay, by, cy, ty, az, bz, cz, tz), angle in zip(here.steps, theta, strict=True):
        c, s = math.cos(angle), math.sin(angle)
        px, py = px + tx * xx + ty * yx + tz * zx, py + tx * xy + ty * yy + tz * zy
        pz += tx * xz + ty * yz + tz * zz
        ux, uy, uz = ax * xx + ay * yx + az * zx, ax * xy + ay * yy + az * zy, ax * xz + ay * yz + az * zz
        vx, vy, vz = bx * xx + by * yx + bz * zx, bx * xy + by * yy + bz * zy, bx * xz + by * yz + bz * zz
        zx, zy, zz = cx * xx + cy * yx + cz * zx, cx * xy + cy * yy + cz * zy, cx * xz + cy * yz + cz * zz
        xx, xy, xz, yx, yy, yz = (
            c * ux + s * vx, c * uy + s * vy, c * uz + s * vz, c * vx - s * ux, c * vy - s * uy, c * vz - s * uz,
        )  # fmt: skip
        frames.append((xx, xy, xz, yx, yy, yz, zx, zy, zz, px, py, pz))
    return frames


def _as_frame(columns: tuple[float, ...]) -> Array:
    xx, xy, xz, yx, yy, yz, zx, zy, zz, px, py, pz = columns
    return np.array([[xx, yx, zx, px], [xy, yy, zy, py], [xz, yz, zz, pz], [0.0, 0.0, 0.0, 1.0]])


def chain(here: Cell, q: Array) -> tuple[Array, Array]:
    """Flange (4, 4) that the controller computes at q (6,) rad, and its derivatives (6, 6) per rad of each
    reported angle in mm and rad.
    """
    frames = _walked(here, q)
    ex, ey, ez = frames[-1][9:]
    rows = []
    for *_, x, y, z, px, py, pz in frames:
        dx, dy, dz = ex - px, ey - py, ez - pz
        rows.append((y * dz - z * dy, z * dx - x * dz, x * dy - y * dx, x, y, z))
    return _as_frame(frames[-1]), np.array(rows).T @ here.nominal.coupling


def links(here: Cell, q: Array) -> list[Array]:
    """Frames (4, 4) of the six links at q (6,) rad; the last one is the flange."""
    return [_as_frame(columns) for columns in _walked(here, q)]


def turn_of(R: Array) -> Array:
    """Rotation vector (3,) rad of a rotation matrix (3, 3)."""
    (xx, yx, zx), (xy, yy, zy), (xz, yz, zz) = R.tolist()
    x, y, z = (yz - zy) / 2, (zx - xz) / 2, (xy - yx) / 2
    sine, cosine = math.sqrt(x * x + y * y + z * z), (xx + yy + zz - 1) / 2
    if cosine < -_NEARLY_BACK:
        vector: Array = Rotation.from_matrix(R).as_rotvec()
        return vector
    part = math.atan2(sine, cosine) / sine if sine > 0 else 1.0
    return np.array([x * part, y * part, z * part])


def solved(here: Cell, F: Array, q: Array) -> Array | None:
    """Return joint angles (6,) rad near q for a flange F (4, 4), or None if Newton's method does not converge."""
    q, place, R = q.copy(), F[:3, 3], F[:3, :3]
    for _ in range(30):
        T, motions = chain(here, q)
        away, turn = place - T[:3, 3], turn_of(R @ T[:3, :3].T)
        if max(map(abs, away.tolist())) < 1e-7 and max(map(abs, turn.tolist())) < 1e-10:
            return q
        *_, step, singular = dgesv(motions, np.concatenate([away, turn]))
        if singular:
            return None
        q += step * min(1.0, 0.6 / max(*map(abs, step.tolist()), 1e-12))
    return None


def branches(dialect: str) -> Array:
    """All postures (n, 6) rad of the arm in the controller with the flange in the middle of the work, the middle
    posture first.

    The closed form of rig gives the start values; the solutions are refined here.
    """
    return _branches(dialect, _chosen["controller"])


@lru_cache
def _branches(dialect: str, controller: str) -> Array:
    here = _cell(dialect, controller)
    arm, (F, _) = arm_of(here.rig.robot), chain(here, here.centre)
    given = inverse(arm, (arm.T_world_base @ F @ arm.T_flange_tool)[None])
    ways = [solved(here, F, q) for q in given.q[0][given.found[0]]]
    others = [q for q in ways if q is not None and here.allows(q) and np.abs(q - here.centre).max() > 0.1]
    return np.array([here.centre, *others])


def placed(place: Array, R: Array) -> Array:
    """Frame (4, 4) with a position (3,) mm and a rotation (3, 3)."""
    T = _EYE.copy()
    T[:3, :3], T[:3, 3] = R, place
    return T


def frame(place: Array | tuple[float, ...], turn: Rotation) -> Array:
    """A frame (4, 4) in mm."""
    return placed(np.asarray(place), turn.as_matrix())
