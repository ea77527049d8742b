"""Curves or points of a result for plots and scripts, in degrees and mm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from analysis.procedures.shared.axis_curves import AxisCurve
from analysis.robot.kinematics.arm import Array, Integers
from analysis.runs.tabular import Tabular


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
