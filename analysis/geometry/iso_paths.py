"""The paths of ISO 9283:1998, 6.8.6, on the inclined plane of the cube, by the length that was driven along each.

The line from P2 to P4; a large circle about P1 of 80 % of the cube's side across and a small one of a tenth of that;
the rectangle P2 P3 P4 P5, whose corners are P2 … P5. The large circle is driven in both directions, as ISO 230-4 asks.
All places are in mm, in the frame in which the cube is given.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from analysis.geometry.iso_cube import FROM_CENTRE, Cube
from analysis.kinematics.arm import Arm, Array
from analysis.kinematics.follow import follow

PathName = Literal["line", "back", "circle", "circle_cw", "small_circle", "rectangle", "way"]
_SMALL = 0.1
"""The small circle's share of the large one."""
_CYCLES: tuple[tuple[PathName, ...], ...] = (
    ("line", "back"),
    ("rectangle",),
    ("circle", "circle_cw"),
    ("small_circle",),
)
"""What each cycle drives, and in which order: all cycles of the first, then all of the next."""
_SAME_MM = 1e-6
"""The rounding of a place that two paths share."""
STAND_S = 2.0
"""Standing before and after each path, by which the tracker's recording is divided."""


@dataclass(frozen=True)
class Polygon:
    """Straight from knot to knot, knots (k, 3) mm."""

    name: PathName
    knots: Array

    @property
    def along(self) -> Array:
        """The length (k,) mm driven at each knot."""
        return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(self.knots, axis=0), axis=1))])

    @property
    def length_mm(self) -> float:
        """The whole length."""
        return float(self.along[-1])

    def at(self, s_mm: Array) -> Array:
        """The places (n, 3) mm after lengths s_mm (n,)."""
        return np.stack([np.interp(s_mm, self.along, column) for column in self.knots.T], axis=1)

    def nearest(self, places: Array) -> Array:
        """The lengths (n,) mm at which the path is nearest to places (n, 3) mm."""
        best, lengths = np.full(len(places), np.inf), np.zeros(len(places))
        for begin, end, s in zip(self.knots[:-1], self.knots[1:], self.along[:-1], strict=True):
            length = float(np.linalg.norm(end - begin))
            on_leg = np.clip((places - begin) @ (end - begin) / length, 0.0, length)
            off = np.linalg.norm(places - begin - on_leg[:, None] * (end - begin) / length, axis=1)
            lengths = np.where(off < best, s + on_leg, lengths)
            best = np.minimum(best, off)
        return lengths


@dataclass(frozen=True)
class Ring:
    """Once around centre (3,) mm, from u towards v, unit vectors (3,)."""

    name: PathName
    centre: Array
    u: Array
    v: Array
    radius_mm: float

    @property
    def length_mm(self) -> float:
        """The whole length."""
        return 2 * float(np.pi) * self.radius_mm

    def at(self, s_mm: Array) -> Array:
        """The places (n, 3) mm after lengths s_mm (n,)."""
        angle = np.asarray(s_mm)[:, None] / self.radius_mm
        places: Array = self.centre + self.radius_mm * (np.cos(angle) * self.u + np.sin(angle) * self.v)
        return places

    def nearest(self, places: Array) -> Array:
        """The lengths (n,) mm at which the path is nearest to places (n, 3) mm."""
        away = places - self.centre
        angle: Array = np.arctan2(away @ self.v, away @ self.u) % (2 * np.pi)
        return angle * self.radius_mm


CommandPath = Polygon | Ring


def paths_of(cube: Cube) -> dict[PathName, CommandPath]:
    """The paths of a cube, in the order in which each cycle drives them; `back` leads from the line's end to its
    beginning over P3, and is not judged."""
    _, p2, p3, p4, p5 = cube.places_mm
    radius, level, rising = FROM_CENTRE * cube.side_mm, cube.level, cube.rising
    paths: tuple[CommandPath, ...] = (
        Polygon("line", np.array([p2, p4])),
        Polygon("back", np.array([p4, p3, p2])),
        Polygon("rectangle", np.array([p2, p3, p4, p5, p2])),
        Ring("circle", cube.centre_mm, level, rising, radius),
        Ring("circle_cw", cube.centre_mm, level, -rising, radius),
        Ring("small_circle", cube.centre_mm, level, rising, _SMALL * radius),
    )
    return {path.name: path for path in paths}


def in_order(cube: Cube, cycles: int) -> Iterator[CommandPath]:
    """Yield the paths as a program drives them, each cycle so many times; `way` leads straight from where the cycles of
    one end to where those of the next begin, and is not judged."""
    paths, at = paths_of(cube), cube.places_mm[1]
    for names in _CYCLES:
        start = paths[names[0]].at(np.zeros(1))[0]
        if np.linalg.norm(start - at) > _SAME_MM:
            yield Polygon("way", np.array([at, start]))
        for name in names * cycles:
            yield paths[name]
        at = start


def joints_along(arm: Arm, cube: Cube, path: CommandPath, s_mm: Array, where: str) -> Array:
    """The joints (n, 6) rad with the tool at rising lengths s_mm (n,) of a path. Raises PathError where the arm cannot
    follow; `where` names the cube."""
    return follow(arm, cube.poses(path.at(s_mm)), cube.q[0], where)
