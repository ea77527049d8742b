"""How far the robot was from the path of its test, by the nominal arm and whatever the gauges say."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.geometry.circle import frame_of
from analysis.geometry.hemisphere import hemisphere_frame
from analysis.geometry.pose_setup import left_in_sockets
from analysis.kinematics.arm import Array
from rigs.schema.declared_tests import Circle, Hemisphere

_ON_PATH = 0.03
_ON_TRACK = 0.3
"""The rig file may know nothing of the tracker's target, so that its places fit roughly only."""
_IN_SOCKET = 0.1
"""Arms as they were built leave up to 0.04 of how far the tool moves (the Pandas of MUKCa); joints in another unit 0.3
and more, since no ball stays anywhere."""
_UPRIGHT = 0.3
"""Radians by which the tool may be turned from what the test prescribes; a joint read wrongly turns it by more."""


@dataclass(frozen=True)
class Off:
    """off_mm: distance from the path at the median; off: the same in shares of its size; on: whether that is as good as
    on it, and the tool turned as the test prescribes."""

    off_mm: float
    off: float
    on: bool


def off_sockets(T: Array, socket: NDArray[np.str_]) -> Off | None:
    """How far the ball is from its sockets at tool poses T (n, 4, 4), wherever these and the ball on the tool are."""
    size = float(np.linalg.norm(T[:, :3, 3] - T[:, :3, 3].mean(axis=0), axis=1).mean())
    if size <= 0:
        return None
    off_mm = float(np.median(np.linalg.norm(left_in_sockets(T, socket), axis=1)))
    return Off(off_mm, off_mm / size, off_mm / size < _IN_SOCKET)


def off_places(T: Array, xyz_mm: Array) -> Off | None:
    """How much farther or less far tool poses T (n, 4, 4) lie apart than places that were seen, xyz_mm (n, 3)."""
    rows = far_rows(xyz_mm)
    size = float(np.median(steps(xyz_mm, rows)))
    if size <= 0:
        return None
    off_mm = float(np.median(np.abs(steps(T[:, :3, 3], rows) - steps(xyz_mm, rows))))
    return Off(off_mm, off_mm / size, off_mm / size < _ON_TRACK)


def off_circle(T: Array, circle: Circle) -> Off:
    """How far tool poses T (n, 4, 4) lie from a circle. The tool points to the ball with its x axis along the circle's
    normal; turned otherwise it is off by an arc."""
    frame = frame_of(circle)
    from_centre = T[:, :3, 3] - frame.centre
    radial = np.abs(np.linalg.norm(from_centre, axis=1) - circle.radius_mm)
    off = float(np.median(np.maximum(radial, np.abs(from_centre @ frame.n))))
    R_nominal = frame.poses(np.arctan2(from_centre @ frame.v, from_centre @ frame.u))[:, :3, :3]
    trace = np.einsum("nij,nij->n", R_nominal, T[:, :3, :3])
    turned = float(np.median(np.arccos(np.clip((trace - 1) / 2, -1.0, 1.0))))
    off_mm = max(off, circle.radius_mm * turned * (turned > _UPRIGHT))
    return Off(off_mm, off_mm / circle.radius_mm, off_mm < _ON_PATH * circle.radius_mm)


def off_targets(T: Array, targets: Array | None, hemisphere: Hemisphere) -> Off:
    """How far tool poses T (n, 4, 4) lie from their targets (n, 3) mm, or where these are unknown from the sphere."""
    frame, places = hemisphere_frame(hemisphere), T[:, :3, 3]
    away = np.abs(np.linalg.norm(places - frame.centre, axis=1) - frame.radius)
    off_mm = float(np.median(away if targets is None else np.linalg.norm(places - targets, axis=1)))
    return Off(off_mm, off_mm / frame.radius, off_mm < _ON_PATH * frame.radius)


def far_rows(places: Array) -> int:
    """How many rows apart places (n, 3) lie farthest from one another, of a few distances in the table.

    Half a table on may be the same place again, where all poses are driven twice, and one row on, where each is
    measured several times at once.
    """
    n = len(places)
    return max((n // 2, n // 3, n // 5, 1), key=lambda rows: float(np.median(steps(places, rows))))


def steps(places: Array, rows: int) -> Array:
    """Distance of each place (n, 3) from that so many rows before it: the same in every frame. (n,) mm."""
    return np.asarray(np.linalg.norm(places - np.roll(places, rows, axis=0), axis=1))
