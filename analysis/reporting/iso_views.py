"""What the pictures of ISO 9283 show: commands on the cube's inclined plane, and deviations from them enlarged."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from analysis.geometry.iso_cube import FROM_CENTRE, cube_of
from analysis.kinematics.arm import Array, arm_of
from analysis.measures.cube import poses_of_cube
from analysis.measures.pose import PoseResult
from analysis.measures.result_curves import PathCurve
from analysis.measures.results import Result
from rigs.schema.vocabulary import DRIVEN_AXES

_SHARE = 0.12
"""The largest deviation is drawn as this share of the cube's side."""
_STATIONS = 80
"""Stations of each path that are drawn, at the most."""


@dataclass(frozen=True)
class PlaneView:
    """Places (n, 2) mm on the plane, level and rising: the command, and where the tool was, its deviation enlarged so
    many times. Gaps between paths are nan."""

    command_mm: Array
    attained_mm: Array
    times: float


def cube_view(result: Result) -> PlaneView | None:
    """The stops of the cube in a pose run; None where it has none."""
    table, rig = result.measured.table, result.measured.rig
    if not isinstance(result.found, PoseResult):
        return None
    if rig.tests.iso9283 is None or len(rig.robot.axes) != DRIVEN_AXES:
        return None
    cube = cube_of(rig)
    pose = poses_of_cube(table.q[result.found.rows], cube)
    if not pose.any():
        return None
    off = result.found.placed_mm[pose > 0] @ arm_of(rig.robot).T_world_base[:3, :3].T
    on_plane = np.stack([cube.level, cube.rising], axis=1)
    places = (cube.places_mm - cube.centre_mm) @ on_plane
    return replace(_enlarged(places[pose[pose > 0] - 1], off @ on_plane, cube.side_mm), command_mm=places)


def path_view(curve: PathCurve) -> PlaneView:
    """The paths and the means of all their cycles; the small circle is no larger than what is enlarged."""
    command, off = [], []
    for name in (path for path in dict.fromkeys(curve.path.tolist()) if path != "small_circle"):
        rows = np.flatnonzero(curve.path == name)
        rows = rows[:: max(1, len(rows) // _STATIONS)]
        command += [curve.place_mm[rows, :2], np.full((1, 2), np.nan)]
        off += [curve.off_mm[rows, :2], np.full((1, 2), np.nan)]
    if not command:
        command, off = [curve.place_mm[:, :2]], [curve.off_mm[:, :2]]
    places, away = np.concatenate(command), np.concatenate(off)
    side = float(np.nanmax(np.abs(places[:, 0]))) / FROM_CENTRE
    return _enlarged(places, away, side)


def _enlarged(places: Array, off: Array, side_mm: float) -> PlaneView:
    largest = max(float(np.nanmax(np.linalg.norm(off, axis=1))), 1e-9)
    times = float(f"{_SHARE * side_mm / largest:.1g}")
    return PlaneView(places, places + times * off, times)
