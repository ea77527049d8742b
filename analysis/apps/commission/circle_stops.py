"""Circle through the stops of a robot that was jogged from point to point."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from analysis.apps.commission.circle_motion import Binned, CircleFit
from analysis.apps.commission.circle_search import DRIVEN, FoundCircle
from analysis.apps.commission.touched_ball import distinct_places, scatter
from analysis.robot.geometry.circle import (
    circles_through,
    deviations,
    largest_deviations,
    nearest_circle,
)
from analysis.robot.kinematics.arm import Arm, Array, Mask, forward
from rigs.errors import FileError

_OFF_MM = 5.0
"""Largest deviation of jogged points from a circle defined by a link."""
_FEWEST = 4
"""Minimum number of stops on a common circle: any three points lie on one."""
_OTHERS = 1 / 3
"""Largest share of stops elsewhere, such as the position of the robot before and after."""
_MOST_STANDS = 40
"""Stops of which all triples are tried, about 10 000. Jogging produces fewer."""
_FOLLOWED = 0.8
"""Minimum share of time on the circle through the stops for a driven circle."""
_LINE = 0.01
"""Flatness of a triangle, relative to its length, below which three points lie on a line."""


def is_jogged(bins: Binned, path_circle: FoundCircle | None) -> bool:
    """True if the robot was jogged from point to point of a circle: between them the path leaves it."""
    places = distinct_places(bins.places[bins.stand_rows])
    if len(places) < 3 or path_circle is None:
        return len(places) > 2
    if len(places) == 3:  # three points always lie on a circle
        return int((deviations(path_circle.circle, places).largest < _OFF_MM).sum()) < 2
    together = on_one_circle(places)
    circle = nearest_circle(places[together])
    if together.sum() < _FEWEST or circle is None:
        return False
    rows = bins.stand_rows[deviations(circle, bins.places[bins.stand_rows]).largest < _OFF_MM]
    between = slice(rows[0], rows[-1])
    follows = deviations(circle, bins.places[between][bins.moving[between]]).largest < DRIVEN.at(circle.radius)
    return bool(follows.mean() < _FOLLOWED) if len(follows) else True


def on_one_circle(places: Array) -> Mask:
    """Mask of the places (m, 3), three or more, on the circle with the most places, then the best fit."""
    triples = np.array(list(combinations(range(min(len(places), _MOST_STANDS)), 3)))
    centre, normal, radius = circles_through(places[triples])
    off = largest_deviations(places, centre, normal, radius)
    near = off < _OFF_MM
    score = near.sum(axis=1) - np.where(near, off, 0.0).sum(axis=1) / (_OFF_MM * len(places))
    return np.asarray(near[int(score.argmax())])


def fit_stops(arm: Arm, bins: Binned, where: str) -> CircleFit:
    q = np.array([stand.q for stand in bins.stands])
    T = forward(arm, q)
    together = on_one_circle(T[:, :3, 3])
    off_circle = int((~together).sum())
    if together.sum() < _FEWEST or off_circle > _OTHERS * len(q):
        together[:], off_circle = True, 0
    q, T = q[together], T[together]
    places = T[:, :3, 3]
    circle = nearest_circle(places)
    extent = np.linalg.svd(places - places.mean(axis=0), compute_uv=False)
    if circle is None or extent[1] < _LINE * extent[0]:
        problem = f"the {len(places)} stops of the robot lie on a straight line"
        raise FileError(where, problem, "stop at points far apart around the circle", code="readings.unsuitable")
    away = deviations(circle, places)
    if (worst_mm := away.largest.max()) > _OFF_MM:
        worst = int(away.largest.argmax()) + 1
        problem = f"the {len(places)} stops are up to {worst_mm:.1f} mm from a circle, most in stop {worst}"
        remedy = "record only stops on the circle, or the circle without stops"
        raise FileError(where, problem, remedy, code="readings.unsuitable")
    squares = float((away.radial**2).sum() + (away.axial**2).sum())
    within_mm = np.sqrt(np.mean([bins.places[stand.settled].var(axis=0).mean() for stand in bins.stands]))
    scatter_mm, doubts = scatter(squares, 2 * (len(places) - 3), float(within_mm))
    if off_circle:
        doubts = (*doubts, f"{off_circle} stops are not used because they are off the circle of the others")
    covariance: Array = np.asarray(scatter_mm**2 * np.linalg.inv(away.design.T @ away.design), dtype=np.float64)
    return CircleFit(circle, covariance, covariance, T, q, f"{len(T)} stops of the robot,", doubts)
