"""How far the robot was from the path of its test, by the nominal arm and whatever the gauges say."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.geometry.circle import frame_of
from analysis.kinematics.arm import Array
from analysis.traces.tables import CircleTable, PoseTable, Table
from rigs.rig import Rig
from rigs.schema.declared_tests import Circle

_ON_PATH = 0.03
_ON_TRACK = 0.3
"""The rig file may know nothing of the tracker's target, so that its places fit roughly only."""


@dataclass(frozen=True)
class Off:
    """off: distance from the path at the median, in shares of its size; on: whether that is as good as on it."""

    off: float
    on: bool


def off_path(T: Array, table: Table, rig: Rig) -> Off | None:
    """How far tool poses (n, 4, 4) lie from the test's path; None where the path is not known."""
    places = T[:, :3, 3]
    circle, hemisphere = rig.tests.circle, rig.tests.hemisphere
    if isinstance(table, PoseTable):
        off, limit = _off_track(places, table.xyz_mm), _ON_TRACK
    elif isinstance(table, CircleTable):
        off, limit = (_off_circle(places, circle) if circle else None), _ON_PATH
    elif hemisphere:
        radius = np.linalg.norm(places - np.array(hemisphere.centre_mm), axis=1)
        off, limit = float(np.median(np.abs(radius - hemisphere.radius_mm))) / hemisphere.radius_mm, _ON_PATH
    else:
        off, limit = None, _ON_PATH
    return None if off is None else Off(off, off < limit)


def _off_track(places: Array, seen: Array) -> float | None:
    rows = far_rows(seen)
    size = float(np.median(steps(seen, rows)))
    return float(np.median(np.abs(steps(places, rows) - steps(seen, rows)))) / size if size > 0 else None


def _off_circle(places: Array, circle: Circle) -> float:
    from_centre = places - np.array(circle.centre_mm)
    radial = np.abs(np.linalg.norm(from_centre, axis=1) - circle.radius_mm)
    return float(np.median(np.maximum(radial, np.abs(from_centre @ frame_of(circle).n)))) / circle.radius_mm


def far_rows(places: Array) -> int:
    """How many rows apart places (n, 3) lie farthest from one another, of a few distances in the table.

    Half a table on may be the same place again, where all poses are driven twice, and one row on, where each is
    measured several times at once.
    """
    n = len(places)
    return max((n // 2, n // 3, n // 5, 1), key=lambda rows: float(np.median(steps(places, rows))))


def steps(places: Array, rows: int) -> Array:
    """Distance of each place (n, 3) from that so many rows before it: the same in every frame. (n,) mm."""
    distances: Array = np.linalg.norm(places - np.roll(places, rows, axis=0), axis=1)
    return distances
