"""Curves or points of a result for plots and scripts, in degrees and mm, and joint reversals on a circle.

One axis at a time: if a single joint turns, the target on the tool moves on a circle about that axis, and its lag or
lead along the circle is the angle error (circle-point analysis; Mooring, Roth and Driels, Fundamentals of Manipulator
Calibration, 1991, ch. 3). Driven in both directions, backlash and curve form one quantity: the bidirectional angular
positioning deviation (Ibaraki, Int. J. Automation Technology 16, 2022), in the terms of ISO 230-2. Because the circle
is fitted, a constant error and most of a wave of one cycle per turn are invisible; compliance of the joint under its
load is visible. No arm model is needed, only the angles and directions of the joint.

A reversal of a joint (comparable with Table 1 of the paper) counts if the joint returns by more than its noise (and
0.05°) on both sides, so encoder noise causes none; its position is the vertex of a local cubic fit.
`analysis.robot.geometry.circle.reversals` returns those of the nominal path.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from analysis.procedures.shared.lap_curve import SEED
from analysis.procedures.shared.quantity import Quantity, figures_of
from analysis.robot.geometry.circle import peaks, reversals
from analysis.robot.geometry.driven_programs import circle_of
from analysis.robot.kinematics.arm import Array, Integers, arm_of
from analysis.runs.laps import Laps
from analysis.runs.noise.readings import noise_beneath
from analysis.runs.noise.spectrum import DRAWS
from analysis.runs.tabular import Tabular
from rigs.rig import Rig

_FEWEST_ANGLES, _LEAST_RAD = 5, np.radians(10)
"""Minimum number of joint angles, and minimum range, for a circle: it has seven parameters, and each angle three
coordinates."""


@dataclass(frozen=True)
class AxisCurve:
    """Angle error of a joint that turned alone, at k angles.

    axis: number of the joint, from 1. radius_mm: radius of the circle of the target. angle_deg: reported angles.
    up_deg, down_deg (k,): true minus reported angle, relative to the fitted circle, after turning up and down; nan if
    not measured. u_deg (k,): standard uncertainty of a value due to the noise of the poses.
    """

    axis: int
    radius_mm: float
    angle_deg: Array
    up_deg: Array
    down_deg: Array
    u_deg: Array


def axis_curves(
    q: Array, sides: Integers, xyz_mm: Array, axes: int
) -> tuple[tuple[AxisCurve, ...], dict[str, Quantity]]:
    """Curve of each joint that turned alone, up and down, and its figures axis3_reversal_deg and
    axis3_bidirectional_deg.

    q (n, k) rad: joints, those of the arm first. sides (n, k): directions of approach, -1, 0 or 1. xyz_mm (n, 3):
    positions. The noise is the scatter across the circle, unaffected by the angle error; it includes compliance of
    other joints.
    """
    curves, figures, rng = list[AxisCurve](), dict[str, Quantity](), np.random.default_rng(SEED)
    for joint in range(axes):
        rows = _rows_of_joint(q, sides, joint)
        # Index of each distinct angle, in increasing order.
        order, number, way = np.argsort(q[rows, joint]), np.zeros(len(rows), dtype=np.int64), sides[rows, joint]
        number[order[1:]] = np.cumsum(np.diff(q[rows, joint][order]) > _SAME_RAD)
        count = int(number.max(initial=-1)) + 1
        if count < _FEWEST_ANGLES or np.ptp(q[rows, joint]) < _LEAST_RAD:
            continue
        radius_mm, off_mm, across_mm = _about_circle(q[rows, joint], xyz_mm[rows])
        freedom = 2 * len(rows) - _ACROSS
        sd = float(np.sqrt((across_mm**2).sum() / freedom)) * np.sqrt(freedom / rng.chisquare(freedom, (DRAWS, 1)))
        drawn = off_mm + sd * rng.standard_normal((DRAWS, len(rows)))
        up, down = (
            _mean_errors(np.vstack([off_mm, drawn]) / radius_mm, number, way == side, count) for side in (1, -1)
        )
        if not np.isfinite(up[0] + down[0]).any():
            continue
        u_deg = np.degrees(np.nanmax([up[1:].std(axis=0), down[1:].std(axis=0)], axis=0))
        at_deg = np.degrees([q[rows, joint][number == k].mean() for k in range(count)])
        curves.append(AxisCurve(joint + 1, radius_mm, at_deg, np.degrees(up[0]), np.degrees(down[0]), u_deg))
        # ISO 230-2:2014: mean reversal error, positive if the joint lags, as with backlash; and the range of the errors
        # of both directions, the bidirectional systematic deviation E.
        wide, ways = f"axis{joint + 1}_bidirectional_deg", np.concatenate([up, down], axis=-1)
        both = {
            f"axis{joint + 1}_reversal_deg": np.degrees(np.nanmean(down - up, axis=-1)),
            wide: np.degrees(np.nanmax(ways, axis=-1) - np.nanmin(ways, axis=-1)),
        }
        values, draws = ({name: figure[part] for name, figure in both.items()} for part in (0, slice(1, None)))
        too_wide = {wide: max(float(draws[wide].mean() - values[wide]), 0.0)}
        figures |= figures_of(values, draws, len(rows), too_wide, excess_u=0.5)
    return tuple(curves), figures


_ACROSS = 5
"""Parameters fitted across the circle: its plane (3), and radius and centre in it (2 of 3)."""
_SAME_RAD = float(np.radians(0.1))
"""Joint motion below which an angle counts as repeated, and a joint as standing."""


def _rows_of_joint(q: Array, sides: Integers, joint: int) -> Integers:
    rows = np.flatnonzero((sides[:, joint] != 0) & (np.delete(sides, joint, axis=1) == 0).all(axis=1))
    if not len(rows):
        return rows
    others = np.delete(q[rows], joint, axis=1)
    alike = (np.abs(others - stood).max(axis=1) < _SAME_RAD for stood in others)  # one row at a time, to save memory
    return np.asarray(rows[max(alike, key=np.count_nonzero)])


def _about_circle(angle: Array, xyz_mm: Array) -> tuple[float, Array, Array]:
    """Radius in mm of the circle through positions xyz_mm (n, 3) at angles (n,) rad, the deviations along it
    (n,) mm, and those across it (n, 2) mm, radial and axial.

    The circle is the least-squares similarity from the unit circle (Umeyama, IEEE PAMI 13, 1991).
    """
    on_unit = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    unit, seen = on_unit - on_unit.mean(axis=0), xyz_mm - xyz_mm.mean(axis=0)
    u, s, vt = np.linalg.svd(unit.T @ seen)
    turn = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    radius_mm = float(s[:2].sum() / (unit**2).sum())
    off = seen @ turn.T - radius_mm * unit
    outwards, along = (off[:, :2] * on_unit[:, :2]).sum(axis=1), off[:, 1] * on_unit[:, 0] - off[:, 0] * on_unit[:, 1]
    return radius_mm, along, np.stack([outwards, off[:, 2]], axis=1)


def _mean_errors(off: Array, number: Integers, kept: Array, count: int) -> Array:
    share = (number[:, None] == np.arange(count)) & np.asarray(kept, dtype=bool)[:, None]
    rows = share.sum(axis=0)
    weight = np.divide(share, rows, out=np.full(share.shape, np.nan), where=rows > 0)
    return np.asarray(off @ weight)


@dataclass(frozen=True)
class CircleCurve(Tabular):
    """Curves of a yaw or roll run over the circle angle: mean of all laps at n = 720 angles.

    phi_deg (n,): circle angle, 0 to 360.
    angle_deg (n,): angle between link and tool.
    error_deg (n,): orientation error, the angle without its least-squares sine, at the stated angular resolution
    (docs/figures.md).
    error_u_deg (n,): standard uncertainty of the error due to noise within the run. It excludes the scatter between
    runs, and the uncertainties of the gauges' time and baseline.
    deviation_mm (n,): radial deviation of the distance from its least-squares circle, positive outwards.
    """

    phi_deg: Array
    angle_deg: Array
    error_deg: Array
    error_u_deg: Array
    deviation_mm: Array

    def to_table(self) -> pa.Table:
        """A row per angle and a column per field."""
        return pa.table(vars(self))


@dataclass(frozen=True)
class RadialCurve(Tabular):
    """Results of a radial run at each target, in order of the target numbers.

    target (t,): number of the target.
    polar_deg, azimuth_deg (t,): direction of the target in the frame of the hemisphere.
    deviation_mm (t,): distance from the least-squares sphere, mean of the orientations.
    spread_mm (t,): range over the orientations.
    used (t,): False if the target is excluded from the sphere.
    """

    target: Integers
    polar_deg: Array
    azimuth_deg: Array
    deviation_mm: Array
    spread_mm: Array
    used: NDArray[np.bool_]

    def to_table(self) -> pa.Table:
        """A row per target and a column per field."""
        return pa.table(vars(self))


@dataclass(frozen=True)
class RepeatabilityCurve(Tabular):
    """Readings of a repeatability run, sorted by target, approach and time.

    target (n,): number of the target.
    approach (n,): `out` or `in`.
    visit (n,): counted from 1 for each target and approach.
    reading_mm (n,): gauge reading.
    """

    target: Integers
    approach: NDArray[np.str_]
    visit: Integers
    reading_mm: Array

    def to_table(self) -> pa.Table:
        """A row per reading and a column per field."""
        return pa.table(vars(self) | {"approach": self.approach.tolist()})


@dataclass(frozen=True)
class PoseCurve(Tabular):
    """Errors of tracker poses or touches in table order, measured minus fitted, in the base of the robot.

    error_mm (n, 3): position error along x, y, z.
    rotation_deg (n, 3): orientation error about x, y, z; None if only positions were measured.
    axes: angle errors of joints that were driven one at a time.
    """

    error_mm: Array
    rotation_deg: Array | None
    axes: tuple[AxisCurve, ...] = ()

    @property
    def distance_mm(self) -> Array:
        """Absolute position error (n,)."""
        return np.asarray(np.linalg.norm(self.error_mm, axis=1))

    def to_table(self) -> pa.Table:
        """A row per pose: row, x_mm, y_mm, z_mm, distance_mm, and rx_deg, ry_deg, rz_deg if measured."""
        row = {"row": np.arange(1, len(self.error_mm) + 1)}
        place = dict(zip(("x_mm", "y_mm", "z_mm"), self.error_mm.T, strict=True))
        turned = () if self.rotation_deg is None else self.rotation_deg.T
        turn = dict(zip(("rx_deg", "ry_deg", "rz_deg"), turned, strict=False))
        return pa.table(row | place | {"distance_mm": self.distance_mm} | turn)


@dataclass(frozen=True)
class PathCurve(Tabular):
    """Paths of ISO 9283 at m stations, one path after the other.

    path (m,): name of the path.
    s_mm (m,): path length from the start.
    share (m,): path length relative to the total length.
    place_mm (m, 3): commanded position in the plane of the cube: horizontal, rising, and normal to the plane.
    off_mm (m, 3): mean of all cycles minus the command, in the same directions.
    at_mm (m,): path accuracy AT at the station.
    rt_mm (m,): path repeatability RT at the station; nan for fewer than three cycles.
    """

    path: NDArray[np.str_]
    s_mm: Array
    share: Array
    place_mm: Array
    off_mm: Array
    at_mm: Array
    rt_mm: Array

    def to_table(self) -> pa.Table:
        """A row per station: path, s_mm, x_mm … of the command, dx_mm … of the deviation, at_mm, rt_mm."""
        place = dict(zip(("x_mm", "y_mm", "z_mm"), self.place_mm.T, strict=True))
        off = dict(zip(("dx_mm", "dy_mm", "dz_mm"), self.off_mm.T, strict=True))
        along = {"path": self.path.tolist(), "s_mm": self.s_mm}
        return pa.table(along | place | off | {"at_mm": self.at_mm, "rt_mm": self.rt_mm})


ResultCurve = CircleCurve | RadialCurve | RepeatabilityCurve | PoseCurve | PathCurve


@dataclass(frozen=True)
class JointReversal:
    """Reversal of a joint on the nominal circle.

    joint: number of the joint, 1 to 6.
    name: name of the joint in the rig file.
    phi_deg: circle angle.
    upper: True if the joint angle changes from rising to falling with increasing circle angle.
    """

    joint: int
    name: str
    phi_deg: float
    upper: bool


def reversals_of_rig(rig: Rig) -> tuple[JointReversal, ...]:
    """Joint reversals on the nominal circle of a rig file, by circle angle.

    Raises FileError if the rig file has no circle, or the robot cannot drive it.
    """
    circle = circle_of(rig)
    turns = reversals(circle, arm_of(rig.robot), rig.name)
    names = [axis.name for axis in rig.robot.axes]
    return tuple(
        JointReversal(turn.axis, names[turn.axis - 1], float(np.degrees(turn.phi)), turn.upper)
        for turn in sorted(turns, key=lambda turn: turn.phi)
    )


PROMINENCE_RAD = float(np.radians(0.05))
"""Smallest joint motion that counts as a reversal."""
_NOISES = 10.0
_BEYOND = np.radians(40.0)
_NEIGHBOURHOOD = np.radians(8.0)


@dataclass(frozen=True)
class MeasuredReversal:
    """Reversal of a joint (1 … 6) at circle angle phi ± u_rad, 0 … 2 pi, in row `row` of the lap; upper: from rising to
    falling with increasing phi."""

    axis: int
    phi: float
    u_rad: float
    upper: bool
    row: int


def turns(laps: Laps) -> list[MeasuredReversal]:
    lap = laps.first
    order = np.argsort(lap.phi, kind="stable")
    phi, q = lap.phi[order], lap.q[order]
    # The closed lap is extended at both ends, so that a reversal near its start has both flanks. A joint with full
    # turns is
    # extended by full turns.
    whole = 2 * np.pi * np.round((q[-1] - q[0]) / (2 * np.pi))
    head, tail = phi < phi[0] + _BEYOND, phi > phi[-1] - _BEYOND
    phi = np.concatenate([phi[tail] - 2 * np.pi, phi, phi[head] + 2 * np.pi])
    q, rows = np.concatenate([q[tail] - whole, q, q[head] + whole]), np.concatenate([order[tail], order, order[head]])
    seen: list[MeasuredReversal] = []
    start = float(phi[0] + _BEYOND)  # of the lap itself
    for axis, joint in enumerate(q.T, start=1):
        turned: list[MeasuredReversal] = []
        prominence = max(PROMINENCE_RAD, _NOISES * noise_beneath(joint, 0.0))
        for sign in (1.0, -1.0):
            for k in peaks(sign * joint, prominence):
                vertex, u = _vertex(phi, sign * joint, float(phi[k]))
                if not start - np.radians(1) <= vertex < start + 2 * np.pi + np.radians(1):
                    continue
                turn = MeasuredReversal(axis, vertex % (2 * np.pi), u, sign > 0, int(rows[k]))
                # A reversal at the seam of the lap is found twice.
                if all(
                    turn.upper != kept.upper or abs(angle_difference(turn.phi, kept.phi)) > np.radians(2)
                    for kept in turned
                ):
                    turned.append(turn)
        seen += turned
    return sorted(seen, key=lambda turn: (turn.axis, turn.phi))


def angle_difference(phi: float, other_phi: float) -> float:
    return float((phi - other_phi + np.pi) % (2 * np.pi) - np.pi)


def _vertex(phi: Array, joint: Array, about: float) -> tuple[float, float]:
    """Position and standard uncertainty, rad, of the extreme near `about`, by a local cubic fit."""
    near = np.abs(phi - about) < _NEIGHBOURHOOD
    if near.sum() < 8:
        return about, float(np.median(np.diff(phi)))
    x = (phi[near] - about) / _NEIGHBOURHOOD
    design = np.vander(x, 4)
    c, *_ = np.linalg.lstsq(design, joint[near], rcond=None)
    residual = joint[near] - design @ c
    tops = np.roots(np.polyder(c))
    tops = np.real(tops[np.isreal(tops)])
    tops = tops[(np.polyval(np.polyder(c, 2), tops) < 0) & (np.abs(tops) <= 1)]
    if len(tops) == 0:
        return about, _NEIGHBOURHOOD / 2
    top = float(tops[np.argmin(np.abs(tops))])
    covariance = np.linalg.inv(design.T @ design) * float(residual @ residual) / max(len(x) - 4, 1)
    slope = np.array([3 * top**2, 2 * top, 1.0, 0.0])
    u = np.sqrt(slope @ covariance @ slope) / abs(np.polyval(np.polyder(c, 2), top))
    return about + top * _NEIGHBOURHOOD, float(u) * _NEIGHBOURHOOD
