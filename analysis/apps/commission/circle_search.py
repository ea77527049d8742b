"""Search for the circular part of a path among approaches, returns and stops.

The path is resampled at equal distances, so stops have no weight. Among circles through triples of points, the one
that the path follows over the largest angle wins. A straight line stays within the tolerance for at most 23°.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.robot.geometry.circle import (
    CircleFrame,
    circle_frame,
    circles_through,
    deviations,
    largest_deviations,
    nearest_circle,
)
from analysis.robot.kinematics.arm import Array, Integers, Mask

_POINTS = 600
"""Points along the path: a tenth of it still has sixty."""
_TRIPLES = 1500
"""Random triples; a few hundred lie on a circle that is a tenth of the path."""
_BEST = 20
"""Triples that are refined."""
_REFINED = 3
"""Fits to the points on a circle."""
_RADIUS_MM = (1.0, 2000.0)
"""Radii allowed in a rig file (`rigs.schema.declared_tests.Circle`)."""
_OF_RADIUS = 0.01
"""Largest deviation relative to the radius: a small circle must not absorb a corner."""
_FEWEST_OF_A_STRETCH = 10
"""Fewer points are the corner between two lines."""
_HOLES = 2
"""Consecutive outliers tolerated within a stretch: a few feedback rows may be wrong."""


@dataclass(frozen=True)
class Tolerance:
    """Distance of a path from a circle that it follows, limited to `scale` hundredths of the radius."""

    mm: float
    scale: float
    least_rad: float

    def at(self, radius_mm: float) -> float:
        return min(self.mm, self.scale * _OF_RADIUS * radius_mm)


DRIVEN = Tolerance(0.5, 1.0, float(np.radians(30.0)))
"""Circle driven by the robot. The constants of a healthy arm bend it by some tenths of a mm."""
BENT = Tolerance(2.0, 3.0, float(np.radians(90.0)))
"""Circle of a controller with other constants than the rig file, such as zeros wrong by 0.5°."""
GUIDED = Tolerance(5.0, 5.0, float(np.radians(120.0)))
"""Circle along which the robot was guided by hand. A line stays within this for up to 52°."""


@dataclass(frozen=True)
class FoundCircle:
    circle: CircleFrame
    turned_rad: float


def even_path(places: Array, run: Integers) -> tuple[Array, Integers]:
    """Resample places (n, 3) to points (k, 3) at equal distances, each with its run number (k,)."""
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    steps[np.diff(run) != 0] = 0.0
    along = np.concatenate([[0.0], np.cumsum(steps)])
    at = np.linspace(0.0, along[-1], _POINTS)
    points = np.stack([np.interp(at, along, column) for column in places.T], axis=1)
    return points, run[np.searchsorted(along, at).clip(max=len(run) - 1)]


def find_circle(points: Array, run: Integers, tolerance: Tolerance) -> FoundCircle | None:
    """Circle that equidistant points (k, 3) in mm follow over the largest angle; None if there is no circle."""
    rng = np.random.default_rng(0)
    half = np.exp(rng.uniform(np.log(3), np.log((len(points) - 1) / 2), _TRIPLES)).astype(int)
    middle = (half + rng.uniform(size=_TRIPLES) * (len(points) - 2 * half)).astype(int)
    rows = np.stack([middle - half, middle, middle + half], axis=1)
    centre, normal, radius = circles_through(points[rows])
    sound = (radius > _RADIUS_MM[0]) & (radius < _RADIUS_MM[1])
    centre, normal, radius, rows = centre[sound], normal[sound], radius[sound], rows[sound]
    limit = np.array([tolerance.at(mm) for mm in radius.tolist()])
    turned = (largest_deviations(points, centre, normal, radius) < limit[:, None]).sum(axis=1) / radius
    best: FoundCircle | None = None
    for k in np.argsort(-turned)[:_BEST]:
        circle, turned_rad = circle_frame(centre[k], normal[k], points[rows[k, 0]] - centre[k], radius[k]), 0.0
        for _ in range(_REFINED):
            on, turned_rad = follow_circle(circle, points, run, tolerance)
            nearest = nearest_circle(points[on]) if on.sum() > 3 else None
            if nearest is None or not _RADIUS_MM[0] < nearest.radius < _RADIUS_MM[1]:
                break
            circle = nearest
        else:
            if best is None or turned_rad > best.turned_rad:
                best = FoundCircle(circle, turned_rad)
    return best


def follow_circle(circle: CircleFrame, points: Array, run: Integers, tolerance: Tolerance) -> tuple[Mask, float]:
    """Mask (k,) of the points in stretches that follow a circle, and the sum of their angles in rad."""
    away = deviations(circle, points)
    rows = np.flatnonzero(away.largest < tolerance.at(circle.radius))
    kept, turned = np.zeros(len(points), dtype=bool), 0.0
    breaks = np.flatnonzero((np.diff(rows) > 1 + _HOLES) | (np.diff(run[rows]) != 0)) + 1
    for stretch in np.split(rows, breaks) if len(rows) else ():
        turned_here = float(np.ptp(np.unwrap(away.phi[stretch])))
        if turned_here >= tolerance.least_rad and len(stretch) >= _FEWEST_OF_A_STRETCH:
            kept[stretch] = True
            turned += turned_here
    return kept, turned
