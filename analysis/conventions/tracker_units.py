"""A tracker's places and angles in another unit or order: held against the robot's own motion, whatever the frames."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from analysis.conventions.gauge_units import FACTORS
from analysis.conventions.off_path import far_rows, steps
from analysis.kinematics.arm import Array
from analysis.traces.tables import PoseTable

_OF_TRACKERS = {"m": 1e-3, "cm": 0.1}
"""Units of trackers beside those of gauges: what a length in mm reads in them."""
_TAKEN_FOR = {"inches": 25.4, "cm": 10.0}
"""What a length in mm reads that was taken for one in another unit, as by a map; in m it reads as one in µm."""
_ABOUT = 0.3
"""The rig file may know nothing of the tracker's target, so that distances are alike roughly only."""
_SAME_TURN_RAD = 0.01
"""Between poses, a tracker and the robot agree on the angle turned to this at the median; …"""
_FARTHER = 8.0
"""… and one way to read the angles is wrong where it is further off than this, and than another by this factor."""


def tracker(table: PoseTable, T: Array) -> Iterator[tuple[str, str]]:
    """What is wrong with the units of a tracker beside nominal tool poses T (n, 4, 4), and what to do."""
    rows = far_rows(table.xyz_mm)
    robot_step, seen = (float(np.median(steps(places, rows))) for places in (T[:, :3, 3], table.xyz_mm))
    for unit, factor in {**FACTORS, **_OF_TRACKERS}.items():
        if robot_step > 1.0 and abs(seen / robot_step / factor - 1) < _ABOUT:
            what = f"x_mm, y_mm, z_mm are in {unit}: they move {seen / robot_step:.3g} times as far as the robot"
            yield what, "convert them to mm"
    for unit, factor in _TAKEN_FOR.items():
        if robot_step > 1.0 and abs(seen / robot_step / factor - 1) < _ABOUT:
            what = f"x_mm, y_mm, z_mm were not in {unit}: they move {seen / robot_step:.3g} times as far as the robot"
            yield what, "read them as mm"
    if table.rpy is not None:
        yield from _tracker_angles(table.rpy, T[:, :3, :3], rows)


def _tracker_angles(rpy: Array, R: Array, rows: int) -> Iterator[tuple[str, str]]:
    """Angles (n, 3) rad as read against the robot's turns R (n, 3, 3): another unit or order fits, and this one not."""
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - slow to import, needed here only

    turned = _turns(R, rows)

    def off(order: str, angles: Array) -> float:
        return float(np.median(np.abs(_turns(Rotation.from_euler(order, angles).as_matrix(), rows) - turned)))

    as_read = off("xyz", rpy)
    if as_read < _SAME_TURN_RAD:
        return
    right = min(_SAME_TURN_RAD, as_read / _FARTHER)
    if off("xyz", np.degrees(rpy)) < right:
        yield "rx_deg, ry_deg, rz_deg are radians: only then do they fit the robot's motion", "convert them to degrees"
    if off("XYZ", rpy) < right:
        what = "rx_deg, ry_deg, rz_deg are turns about moving axes: only then do they fit the robot's motion"
        yield what, "convert them to roll-pitch-yaw about fixed axes, R = Rz Ry Rx"


def _turns(R: Array, rows: int) -> Array:
    """Angle (n,) rad between each rotation (n, 3, 3) and that so many rows before it: the same in every frame."""
    trace = np.einsum("nij,nij->n", R, np.roll(R, rows, axis=0))
    angles: Array = np.arccos(np.clip((trace - 1) / 2, -1.0, 1.0))
    return angles
