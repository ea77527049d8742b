"""Which part of a path is the circle: found among approaches, ways home and stops, without knowing the circle.

The path is taken at even steps of distance, so that a stop weighs nothing. Circles through three of its points, near
and far apart, are held against all of it; the one along which the path turns furthest without leaving it wins. A
straight line stays within the tolerance of a circle for 23° at the most. An arm that swings one joint seldom turns as
far as a programmed circle; where it does, that is a second circle, and a person decides.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.geometry.circle import CircleFrame, circle_frame
from analysis.geometry.circle_through import circles_through, deviations, largest_deviations, nearest_circle
from analysis.kinematics.arm import Array, Integers, Mask

_POINTS = 600
"""Points along the path, so that a tenth of it still has sixty."""
_TRIPLES = 1500
"""Some hundred have all three points on the circle, also where it is only a tenth of the path."""
_BEST = 20
"""Triples of points that are refined: those that turn furthest, most of which are the same circle."""
_REFINED = 3
"""Times that a circle is fitted to what lies on it; it ends earlier where nothing changes."""
_RADIUS_MM = (1.0, 2000.0)
"""Radii that a rig file may have (`rigs.schema.declared_tests.Circle`)."""
_OF_RADIUS = 0.01
"""Share of the radius that a point may be off at the most, so that a small circle does not take in a corner."""
_FEWEST = 10
"""Points of a stretch; fewer are the corner where two lines meet."""
_HOLES = 2
"""Points in a row that may be off: a row or two of the feedback wrong."""


@dataclass(frozen=True)
class Tolerance:
    """How far, in mm, a path may be off its circle, at most `scale` hundredths of the radius, and the arc in rad along
    which it must follow it to be one."""

    mm: float
    scale: float
    least_rad: float

    def at(self, radius_mm: float) -> float:
        """The tolerance in mm on a circle of this radius."""
        return min(self.mm, self.scale * _OF_RADIUS * radius_mm)


DRIVEN = Tolerance(0.5, 1.0, float(np.radians(30.0)))
"""A robot's own circle: the constants of a healthy arm bend it by some tenths of a mm."""
BENT = Tolerance(2.0, 3.0, float(np.radians(90.0)))
"""The circle of a robot whose controller has other constants than the rig file, as with zeros off by half a degree."""
LED = Tolerance(5.0, 5.0, float(np.radians(120.0)))
"""A circle along which a person led the robot; a line is as near to it for up to 52°."""


@dataclass(frozen=True)
class FoundCircle:
    """A circle in a path, and along how much of it, in rad, the path went."""

    circle: CircleFrame
    turned_rad: float


def even_path(places: Array, run: Integers) -> tuple[Array, Integers]:
    """At most some hundred points (k, 3) mm at even distances along places (n, 3) mm, and the run (k,) of each."""
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    steps[np.diff(run) != 0] = 0.0
    along = np.concatenate([[0.0], np.cumsum(steps)])
    at = np.linspace(0.0, along[-1], _POINTS)
    points = np.stack([np.interp(at, along, column) for column in places.T], axis=1)
    return points, run[np.searchsorted(along, at).clip(max=len(run) - 1)]


def find_circle(points: Array, run: Integers, tolerance: Tolerance) -> FoundCircle | None:
    """The circle along which a path of even steps (k, 3) mm in runs (k,) by number turns furthest; None without one."""
    rng = np.random.default_rng(0)
    half = np.exp(rng.uniform(np.log(3), np.log((len(points) - 1) / 2), _TRIPLES)).astype(int)
    middle = (half + rng.uniform(size=_TRIPLES) * (len(points) - 2 * half)).astype(int)
    rows = np.stack([middle - half, middle, middle + half], axis=1)
    centre, normal, radius = circles_through(points[rows])
    sound = (radius > _RADIUS_MM[0]) & (radius < _RADIUS_MM[1])
    centre, normal, radius, rows = centre[sound], normal[sound], radius[sound], rows[sound]
    limit = np.array([tolerance.at(one) for one in radius.tolist()])
    turned = (largest_deviations(points, centre, normal, radius) < limit[:, None]).sum(axis=1) / radius
    found: FoundCircle | None = None
    for k in np.argsort(-turned)[:_BEST]:
        circle = circle_frame(centre[k], normal[k], points[rows[k, 0]] - centre[k], radius[k])
        one = _refined(points, run, circle, tolerance)
        if one and (found is None or one.turned_rad > found.turned_rad):
            found = one
    return found


def _refined(points: Array, run: Integers, circle: CircleFrame, tolerance: Tolerance) -> FoundCircle | None:
    turned = 0.0
    for _ in range(_REFINED):
        on, turned = followed(circle, points, run, tolerance)
        nearest = nearest_circle(points[on]) if on.sum() > 3 else None
        if nearest is None or not _RADIUS_MM[0] < nearest.radius < _RADIUS_MM[1]:
            return None
        circle = nearest
    return FoundCircle(circle, turned)


def followed(circle: CircleFrame, points: Array, run: Integers, tolerance: Tolerance) -> tuple[Mask, float]:
    """Which points (k, 3) mm of runs (k,) by number belong to stretches that follow a circle, and how far these turn in
    rad."""
    away = deviations(circle, points)
    on = away.largest < tolerance.at(circle.radius)
    rows = np.flatnonzero(on)
    kept, turned = np.zeros(len(points), dtype=bool), 0.0
    if not len(rows):
        return kept, turned
    breaks = np.flatnonzero((np.diff(rows) > 1 + _HOLES) | (np.diff(run[rows]) != 0)) + 1
    for stretch in np.split(rows, breaks):
        own = float(np.ptp(np.unwrap(away.phi[stretch])))
        if own >= tolerance.least_rad and len(stretch) >= _FEWEST:
            kept[stretch] = True
            turned += own
    return kept, turned
