"""Circles and spheres through points at which the robot stood, each point with the scatter that all of them show.

So few points show their scatter badly: u is widened by Student's factor, so that 2 u holds 95 % whatever their number.
Where they leave nothing over (three points of a circle, four of a sphere), what the joints did within each stand is all
that is known of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from analysis.fitting.circle_rows import Binned
from analysis.fitting.circle_search import DRIVEN, FoundCircle
from analysis.geometry.circle import CircleFrame
from analysis.geometry.circle_through import circles_through, deviations, largest_deviations, nearest_circle
from analysis.kinematics.arm import Arm, Array, Mask, forward
from rigs.errors import FileError

_APART_MM = 5.0
"""Stands nearer to each other are at one place."""
_OFF_MM = 5.0
"""A person jogs to a point of a circle that a link holds to better than this."""
_FEWEST = 4
"""Stands on one circle that are no chance: any three are on one."""
_OTHERS = 1 / 3
"""Share of stands that may be elsewhere, as where the robot stood before and after."""
_MOST_STANDS = 40
"""Stands whose triples are tried, some 10 000; a person jogs to fewer."""
_FOLLOWED = 0.8
"""Share of the time of a driven circle that the robot is on the circle through its stops."""
_LINE = 0.01
"""Three points whose triangle is flatter than this share of its length are on a line."""


@dataclass(frozen=True)
class StoodCircle:
    """A circle through m stands: tool poses T (m, 4, 4) mm and angles q (m, 6) rad in order of time; covariance (3, 3)
    mm² of the coefficients of its radial and, alike, of its axial deviations; doubts in words."""

    circle: CircleFrame
    T: Array
    q: Array
    covariance: Array
    doubts: tuple[str, ...]


def distinct(places: Array) -> Array:
    """The places (k, 3) mm among places (m, 3) mm that are apart from each other."""
    found: list[Array] = []
    for place in places:
        if all(np.linalg.norm(place - other) > _APART_MM for other in found):
            found.append(place)
    return np.array(found).reshape(-1, 3)


def is_jogged(bins: Binned, found: FoundCircle | None) -> bool:
    """Whether the robot was jogged from point to point of a circle, and did not drive the one that its path shows.

    Between the points of a jog the path leaves the circle through them; a person also stands where the robot is at
    home, and a program where it turns back."""
    places = distinct(bins.places[bins.stand_rows])
    if len(places) < 3 or found is None:
        return len(places) > 2
    if len(places) == 3:  # on a circle wherever they are
        return int((deviations(found.circle, places).largest < _OFF_MM).sum()) < 2
    together = on_one_circle(places)
    circle = nearest_circle(places[together])
    if together.sum() < _FEWEST or circle is None:
        return False
    rows = bins.stand_rows[deviations(circle, bins.places[bins.stand_rows]).largest < _OFF_MM]
    between = slice(rows[0], rows[-1])
    follows = deviations(circle, bins.places[between][bins.moving[between]]).largest < DRIVEN.at(circle.radius)
    return bool(follows.mean() < _FOLLOWED) if len(follows) else True


def on_one_circle(places: Array) -> Mask:
    """A mask of the places (m, 3) mm, three or more, that lie on one circle: that on which the most do, and best."""
    triples = np.array(list(combinations(range(min(len(places), _MOST_STANDS)), 3)))
    centre, normal, radius = circles_through(places[triples])
    off = largest_deviations(places, centre, normal, radius)
    near = off < _OFF_MM
    worth = near.sum(axis=1) - np.where(near, off, 0.0).sum(axis=1) / (_OFF_MM * len(places))
    together: Mask = near[int(worth.argmax())]
    return together


def circle_through_stands(arm: Arm, bins: Binned, where: str) -> StoodCircle:
    """The circle through the stands, without a few that are elsewhere. Raises FileError where they lie on a line, or
    are on no circle."""
    q = np.array([stand.q for stand in bins.stands])
    T = forward(arm, q)
    together = on_one_circle(T[:, :3, 3])
    others = len(q) - int(together.sum())
    if together.sum() < _FEWEST or others > _OTHERS * len(q):
        together[:] = True
    q, T = q[together], T[together]
    places = T[:, :3, 3]
    circle = nearest_circle(places)
    extent = np.linalg.svd(places - places.mean(axis=0), compute_uv=False)
    if circle is None or extent[1] < _LINE * extent[0]:
        what = f"the {len(places)} points at which the robot stood lie on a line"
        raise FileError(where, what, "stand at points far apart around the circle")
    away = deviations(circle, places)
    if away.largest.max() > _OFF_MM:
        worst = int(away.largest.argmax())
        what = (
            f"the {len(places)} stands lie up to {away.largest[worst]:.1f} mm off one circle, most in stand {worst + 1}"
        )
        raise FileError(where, what, "record only stands on the circle, or the circle itself without stops")
    free = 2 * (len(places) - 3)
    left = float((away.radial**2).sum() + (away.axial**2).sum())
    scatter_mm, doubts = scatter(left, free, _within(bins))
    if not together.all():
        doubts = (*doubts, f"{others} stands are not used because they lie off the circle of the others")
    design = away.design
    covariance: Array = np.asarray(scatter_mm**2 * np.linalg.inv(design.T @ design), dtype=np.float64)
    return StoodCircle(circle, T, q, covariance, doubts)


def scatter(squares: float, free: int, within_mm: float) -> tuple[float, tuple[str, ...]]:
    """Scatter in mm of one coordinate of a point, widened for few points, and a doubt where the points show none.

    squares: of what is left, mm²; free: its degrees of freedom; within_mm: scatter in mm within the stands."""
    if free <= 0:
        return within_mm, ("as few points leave no residual: u has only the scatter within the stands; add a point",)
    from scipy.special import stdtrit  # noqa: PLC0415 - slow to import, needed here only

    return float(np.sqrt(squares / free) * stdtrit(free, 0.975) / 1.96), ()


def _within(bins: Binned) -> float:
    """Root mean square in mm of how places move in one coordinate while the robot stands."""
    return float(np.sqrt(np.mean([bins.places[one.settled].var(axis=0).mean() for one in bins.stands])))
