"""Arms for each dialect: the nominal arm of the controller, which solves poses, and the real arm with errors.

Both are computed here from the constants of the rig file (modified Denavit-Hartenberg, mm, rad).
"""

from __future__ import annotations

import datetime as dt
import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgesv
from scipy.spatial.transform import Rotation

from analysis.robot.kinematics.arm import arm_of
from analysis.robot.kinematics.inverse import inverse
from rigs.effects import EffectProvenance, JointOffset, LinkGeometry, TransmissionError
from rigs.rig import Rig
from tests.worlds.arms.independent_arm import Constants, Wrong, flange
from tests.worlds.interpreters.arms import rig_of

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
_FOUND = EffectProvenance(
    date=dt.date(2026, 11, 20), runs=("yaw-acw-001",), sd={"offset_deg": 1e-3, "delta": 0.01, "amplitude_deg": 5e-4}
)


def _found(key: str) -> EffectProvenance:
    return _FOUND.model_copy(update={"sd": {key: _FOUND.sd[key]}})


@dataclass(frozen=True)
class Cell:
    """An arm with a rig file that states its errors."""

    rig: Rig
    nominal: Constants
    wrong: Wrong
    centre: Array
    limits: Array

    @cached_property
    def twisted(self) -> list[list[float]]:
        """Return for each axis a in mm, cosine and sine of alpha, and d in mm."""
        arm = self.nominal
        return np.column_stack([arm.a, np.cos(arm.alpha), np.sin(arm.alpha), arm.d]).tolist()

    def allows(self, q: Array) -> bool:
        """Return whether joint angles (6,) rad are within the limits."""
        return bool((q >= self.limits[:, 0]).all() and (q <= self.limits[:, 1]).all())

    def flanges(self, q: Array) -> Array:
        """Return the real flange frames (n, 4, 4) in the base at reported angles q (n, 6) rad."""
        R, p = flange(self.nominal, self.wrong, q)
        T = np.tile(np.eye(4), (len(q), 1, 1))
        T[:, :3, :3], T[:, :3, 3] = R, p
        return T


@lru_cache
def cell(dialect: str) -> Cell:
    """Return the cell of a dialect."""
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
    wrong = Wrong(*(np.zeros(6) for _ in range(4)), np.zeros((6, 2)), np.zeros((6, 2)))
    wrong.offset[:] = np.radians(_ZEROS_DEG)
    wrong.a[2] = _A3_MM
    wrong.sine[0, 1] = np.radians(_GEAR_DEG)
    axes = rig.robot.axes
    nominal = Constants(
        np.array([axis.a_mm for axis in axes]),
        np.radians([axis.alpha_deg for axis in axes]),
        np.array([axis.d_mm for axis in axes]),
        np.radians([axis.offset_deg for axis in axes]),
        np.array(rig.robot.coupling),
    )
    known = rig.model_copy(update={"effects": (*zeros, *others)})
    limits = np.radians([axis.limits_deg for axis in axes])
    return Cell(known, nominal, wrong, np.radians(np.array(POSTURE_DEG[dialect], dtype=float)), limits)


def _walked(here: Cell, q: Array) -> list[tuple[float, ...]]:
    """Return the frames of the six links at q (6,) rad, each as twelve numbers by columns: three axes, position.

    Plain floats are five times as fast as products of small arrays, and a trial needs thousands per program.
    """
    xx, xy, xz, yx, yy, yz, zx, zy, zz, px, py, pz = 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0
    frames = []
    theta = (here.nominal.coupling @ q + here.nominal.offset).tolist()
    for (a, ca, sa, d), angle in zip(here.twisted, theta, strict=True):
        c, s = math.cos(angle), math.sin(angle)
        px, py, pz = px + a * xx, py + a * xy, pz + a * xz
        ux, uy, uz = ca * yx + sa * zx, ca * yy + sa * zy, ca * yz + sa * zz
        zx, zy, zz = ca * zx - sa * yx, ca * zy - sa * yy, ca * zz - sa * yz
        px, py, pz = px + d * zx, py + d * zy, pz + d * zz
        xx, xy, xz, yx, yy, yz = (
            c * xx + s * ux, c * xy + s * uy, c * xz + s * uz, c * ux - s * xx, c * uy - s * xy, c * uz - s * xz,
        )  # fmt: skip
        frames.append((xx, xy, xz, yx, yy, yz, zx, zy, zz, px, py, pz))
    return frames


def _as_frame(columns: tuple[float, ...]) -> Array:
    xx, xy, xz, yx, yy, yz, zx, zy, zz, px, py, pz = columns
    return np.array([[xx, yx, zx, px], [xy, yy, zy, py], [xz, yz, zz, pz], [0.0, 0.0, 0.0, 1.0]])


def chain(here: Cell, q: Array) -> tuple[Array, Array]:
    """Return the nominal flange (4, 4) at q (6,) rad, and its derivatives (6, 6) per rad of each reported angle in
    mm and rad.
    """
    frames = _walked(here, q)
    ex, ey, ez = frames[-1][9:]
    rows = []
    for *_, x, y, z, px, py, pz in frames:
        dx, dy, dz = ex - px, ey - py, ez - pz
        rows.append((y * dz - z * dy, z * dx - x * dz, x * dy - y * dx, x, y, z))
    return _as_frame(frames[-1]), np.array(rows).T @ here.nominal.coupling


def links(here: Cell, q: Array) -> list[Array]:
    """Return the frames (4, 4) of the six links at q (6,) rad; the last one is the flange."""
    return [_as_frame(columns) for columns in _walked(here, q)]


def turn_of(R: Array) -> Array:
    """Return the rotation vector (3,) rad of a rotation matrix (3, 3)."""
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


@lru_cache
def branches(dialect: str) -> Array:
    """Return all postures (n, 6) rad of the nominal arm with the flange in the middle of the work, the middle posture
    first.

    The closed form of rig gives the start values; the solutions are refined here.
    """
    here = cell(dialect)
    arm, (F, _) = arm_of(here.rig.robot), chain(here, here.centre)
    given = inverse(arm, (arm.T_world_base @ F @ arm.T_flange_tool)[None])
    ways = [solved(here, F, q) for q in given.q[0][given.found[0]]]
    others = [q for q in ways if q is not None and here.allows(q) and np.abs(q - here.centre).max() > 0.1]
    return np.array([here.centre, *others])


def placed(place: Array, R: Array) -> Array:
    """Return the frame (4, 4) with a position (3,) mm and a rotation (3, 3)."""
    T = _EYE.copy()
    T[:3, :3], T[:3, 3] = R, place
    return T


def frame(place: Array | tuple[float, ...], turn: Rotation) -> Array:
    """Return a frame (4, 4) in mm."""
    return placed(np.asarray(place), turn.as_matrix())
