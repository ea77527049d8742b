"""The cube of ISO 9283:1998 in the work space of an arm: five poses on its inclined plane, 6.8, and a search for its
place.

P1 is the centre; P2 … P5 lie on the space diagonals, 10 % of a diagonal from their ends, on one of the four planes
through two opposite edges: P2 and P3 low, P4 and P5 high, P2 opposite to P4. The tool orientation is constant. The
standard is not public; clauses and numbers follow public quotations (docs/figures.md).

The paths, 6.8.6, lie on the same plane, parametrised by their length: the line from P2 to P4; a large circle about P1
with 80 % of the cube's side as diameter and a small one of a tenth of that; the rectangle P2 P3 P4 P5. The large circle
is driven in both directions, as required by ISO 230-4. All positions are in mm, in the frame of the cube.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from typing import Literal

import numpy as np

from analysis.robot.geometry.clearance import is_clear
from analysis.robot.kinematics.arm import Arm, Array, Integers, Mask, arm_of, forward, link_frames
from analysis.robot.kinematics.follow import follow
from analysis.robot.kinematics.inverse import inverse
from analysis.robot.kinematics.joint_limits import within_limits
from analysis.robot.kinematics.newton import conditioning, newton
from rigs.errors import FileError, PathError, RigPlace
from rigs.readiness import require_part
from rigs.rig import Rig
from rigs.schema.declared_tests import Iso9283
from rigs.schema.robot import Robot
from rigs.schema.vocabulary import DRIVEN_AXES

ORDER = (5, 4, 3, 2, 1)
"""Order of the poses in a cycle, 6.10 of the standard."""
FROM_CENTRE = 0.4
"""Distance of P2 … P5 from the centre along each edge, relative to the side: half less 10 % of the diagonal."""
_CORNERS = np.array([[0, 0], [-1, -1], [1, -1], [1, 1], [-1, 1]])
"""P1 … P5 along the horizontal and rising directions of the plane, in units of FROM_CENTRE."""
_REACHES = (0.25, 0.35, 0.45, 0.55, 0.65)
_HEIGHTS = (0.15, 0.25, 0.35, 0.45, 0.55, 0.65)
"""Heights of the centres tried, relative to the reach."""
_SIDES = (0.4, 0.35, 0.3, 0.25, 0.2, 0.15, 0.1)
"""Side lengths tried, relative to the reach of the arm. A cube of 0.4 fills the space in front of most arms."""
_REGULAR = 0.03
"""Minimum conditioning at and between the poses: the shipped circles have three to six times as much."""
_ALONG = 9
"""Number of poses along each side of the plane that must also be reachable."""
_SWING = np.radians(60.0)
"""Limit of joint motion from the centre to any point on the plane."""
_MARGIN = np.radians(2.0)
"""Margin of every joint to its limits."""
_WHOLE_MM = 10.0
"""Step in mm to which side lengths and centres found by a search are rounded."""
_TRIED, _STEPS = 100, 12
"""Number of postures tried in each direction, and number of Newton steps from the centre to a pose."""


@dataclass(frozen=True)
class Cube:
    """Poses of a cube.

    centre_mm (3,), level and rising (3,) unit vectors of the plane, in the world; R (3, 3): tool orientation; q (5,
    axes) rad: joints at P1 … P5; found: whether the place comes from a search.
    """

    centre_mm: Array
    side_mm: float
    level: Array
    rising: Array
    R: Array
    q: Array
    found: bool = False

    @property
    def half_mm(self) -> tuple[float, float]:
        return FROM_CENTRE * self.side_mm, FROM_CENTRE * self.side_mm * float(np.sqrt(2))

    def on_plane(self, along: Array) -> Array:
        """World positions (n, 3) mm of positions (n, 2) mm on the plane: horizontal and rising coordinate."""
        return np.asarray(self.centre_mm + along @ np.stack([self.level, self.rising]))

    @property
    def places_mm(self) -> Array:
        return self.on_plane(_CORNERS * self.half_mm)

    @property
    def distance_mm(self) -> float:
        return 2 * FROM_CENTRE * self.side_mm * float(np.sqrt(3))

    def poses(self, places_mm: Array) -> Array:
        T = np.tile(np.eye(4), (len(places_mm), 1, 1))
        T[:, :3, :3], T[:, :3, 3] = self.R, places_mm
        return T


def iso9283_of(rig: Rig) -> Iso9283:
    return require_part(rig, rig.tests.iso9283, "iso9283")


def cube_of(rig: Rig) -> Cube:
    test, where = iso9283_of(rig), RigPlace.of(rig.name, "tests.iso9283")
    if len(rig.robot.axes) != DRIVEN_AXES:
        problem = f"is for an arm of {len(rig.robot.axes)} axes, but programs of the cube need {DRIVEN_AXES} axes"
        raise FileError(where, problem, "measure it by planned poses: rig plan RIG --poses 30", code="arm.invalid")
    cube = _cube(rig.robot, test)
    if cube is None:
        stated = [name for name in ("centre_mm", "side_mm", "posture_deg") if getattr(test, name) is not None]
        fact = f"no cube with this {', '.join(stated)} is" if stated else "no cube was found that is"
        problem = f"{fact} reached on its whole plane, clear of floor, column and singularities, in one posture"
        remedy = "choose a different centre_mm, a smaller side_mm, or posture_deg near the centre"
        raise PathError(where, problem, remedy, "reach")
    return cube


@lru_cache(maxsize=64)
def _cube(robot: Robot, test: Iso9283) -> Cube | None:
    arm = arm_of(robot)
    # The plane rises along a direction of the base.
    ahead, upwards = np.eye(3)["xy".index(test.rises[-1])] * (-1.0 if test.rises.startswith("-") else 1.0), np.eye(3)[2]
    R = arm.T_world_base[:3, :3]
    level, rising = R @ np.cross(upwards, ahead), R @ ((ahead + upwards) / np.sqrt(2))
    if test.side_mm is not None:
        sides = [test.side_mm]
    else:
        sides = [max(1, round(share * _reach_mm(arm) / _WHOLE_MM)) * _WHOLE_MM for share in _SIDES]
    looked_for = test.posture_deg is None or test.side_mm is None
    share, corners = np.linspace(-1, 1, _ALONG), slice(None, len(_CORNERS))
    for starts, side in ((starts, side) for starts in _starts(arm, test) for side in sides):
        grid = np.array([*_CORNERS, *product(share, share)]) * FROM_CENTRE * side * np.array([1.0, np.sqrt(2)])
        away = grid @ np.stack([level, rising])
        candidates = np.arange(len(starts.q))
        for start in candidates[_reached(arm, starts, candidates, away[corners])[1]]:
            q, reached = _reached(arm, starts, np.array([start]), away)
            if reached[0]:
                centre_mm, R = starts.centre_mm[start], starts.R[start]
                return Cube(centre_mm, float(side), level, rising, R, q[0, corners], looked_for)
    return None


@dataclass(frozen=True)
class _Starts:
    """Centres to try, best first: centre_mm (n, 3) in the world, tool R (n, 3, 3), joints q (n, 6) rad."""

    centre_mm: Array
    R: Array
    q: Array


def _starts(arm: Arm, test: Iso9283) -> Iterator[_Starts]:
    if test.posture_deg is not None:
        posture = np.radians(test.posture_deg)
        T = forward(arm, posture[None])
        if test.centre_mm is not None:
            T[0, :3, 3] = test.centre_mm
        q, good = newton(arm, T, posture[None])
        yield _Starts(T[good, :3, 3], T[good, :3, :3], q[good])
        return
    base, reach = arm.T_world_base, _reach_mm(arm)
    if test.centre_mm is not None:
        away = (np.linalg.inv(base) @ [*test.centre_mm, 1.0])[:2]
        yield _postures(arm, np.array([test.centre_mm]), away / max(float(np.linalg.norm(away)), 1e-9))
        return
    for ahead in np.array([[1.0, 0.0], [0.0, 1.0], [0.0, -1.0], [-1.0, 0.0]]):
        spots = reach * np.array([[*r * ahead, z] for r, z in product(_REACHES, _HEIGHTS)])
        spots = _WHOLE_MM * np.rint(spots / _WHOLE_MM)
        yield _postures(arm, spots @ base[:3, :3].T + base[:3, 3], ahead)


def _postures(arm: Arm, places: Array, ahead: Array) -> _Starts:
    """Postures at positions (n, 3) mm with the tool down or ahead (2,), in four rolls, most regular first.

    They are collision-free, regular, within half a turn, and with the elbow on the side of the position.
    """
    turns = []
    down, level, upwards = np.array([0.0, 0.0, -1.0]), np.array([*ahead, 0.0]), np.array([0.0, 0.0, 1.0])
    for z, x in ((down, level), (level, upwards)):
        y = np.cross(z, x)
        turns += [np.stack([*rolled, z], axis=1) for rolled in ((x, y), (y, -x), (-x, -y), (-y, x))]
    poses = np.tile(np.eye(4), (len(places) * len(turns), 1, 1))
    poses[:, :3, 3] = np.repeat(places, len(turns), axis=0)
    poses[:, :3, :3] = np.tile(arm.T_world_base[:3, :3] @ np.array(turns), (len(places), 1, 1))
    solved = inverse(arm, poses)
    rows, slots = np.nonzero(solved.found)
    q, source = within_limits(arm, solved.q[rows, slots])
    rows = rows[source]
    kept = np.flatnonzero((np.abs(q) <= np.pi).all(axis=1))
    if len(kept):
        elbow = (np.linalg.inv(arm.T_world_base) @ link_frames(arm, q[kept])[:, 2])[:, :2, 3]
        even = conditioning(arm, q[kept])
        good = is_clear(arm, q[kept]) & (elbow @ ahead > 0) & (even > _REGULAR)
        kept = kept[good][np.argsort(-even[good], kind="stable")][:_TRIED]
    T = poses[rows[kept]]
    return _Starts(T[:, :3, 3], T[:, :3, :3], q[kept])


def _reach_mm(arm: Arm) -> float:
    return float(np.hypot(arm.a, arm.d).sum())


def _reached(arm: Arm, starts: _Starts, rows: Integers, away: Array) -> tuple[Array, Mask]:
    """Joints (m, k, 6) rad at offsets away (k, 3) mm from centres, and a mask (m,) of completely valid centres."""
    poses = np.tile(np.eye(4), (len(rows), len(away), 1, 1))
    poses[:, :, :3, :3] = starts.R[rows, None]
    poses[:, :, :3, 3] = starts.centre_mm[rows, None] + away
    begin = np.repeat(starts.q[rows], len(away), axis=0)
    q, good = newton(arm, poses.reshape(-1, 4, 4), begin, _STEPS)
    good &= ((q > arm.limits[:, 0] + _MARGIN) & (q < arm.limits[:, 1] - _MARGIN)).all(axis=1)
    good &= np.abs(q - begin).max(axis=1) < _SWING
    within = np.flatnonzero(good)
    if len(within):
        good[within] = is_clear(arm, q[within]) & (conditioning(arm, q[within]) > _REGULAR)
    shape = len(rows), len(away)
    return q.reshape(*shape, arm.axes), np.asarray(good.reshape(shape).all(axis=1))


def cycle_stops(rig: Rig) -> Array:
    """Joints (n, 6) rad of all stops for a tracker, P5 P4 P3 P2 P1 in each cycle. Raises FileError like `cube_of`."""
    return np.asarray(cube_of(rig).q[np.tile(np.array(ORDER) - 1, iso9283_of(rig).cycles)])


PathName = Literal["line", "back", "circle", "circle_cw", "small_circle", "rectangle", "way"]
_SMALL = 0.1
"""Size of the small circle relative to the large one."""
_CYCLES: tuple[tuple[PathName, ...], ...] = (
    ("line", "back"),
    ("rectangle",),
    ("circle", "circle_cw"),
    ("small_circle",),
)
"""Paths per cycle, in order: all cycles of the first entry, then all of the next."""
_SAME_MM = 1e-6
"""Rounding of a position shared by two paths."""
STANDSTILL_S = 2.0
"""Standstill before and after each path, by which the tracker's recording is split."""


@dataclass(frozen=True)
class Polygon:
    """Straight lines between knots (k, 3) mm."""

    name: PathName
    knots: Array

    @property
    def arc_length_mm(self) -> Array:
        return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(self.knots, axis=0), axis=1))])

    @property
    def length_mm(self) -> float:
        return float(self.arc_length_mm[-1])

    def at(self, s_mm: Array) -> Array:
        return np.stack([np.interp(s_mm, self.arc_length_mm, column) for column in self.knots.T], axis=1)

    def nearest(self, places: Array) -> Array:
        """Lengths (n,) mm of the closest path points."""
        best, lengths = np.full(len(places), np.inf), np.zeros(len(places))
        for begin, end, s in zip(self.knots[:-1], self.knots[1:], self.arc_length_mm[:-1], strict=True):
            length = float(np.linalg.norm(end - begin))
            on_leg = np.clip((places - begin) @ (end - begin) / length, 0.0, length)
            off = np.linalg.norm(places - begin - on_leg[:, None] * (end - begin) / length, axis=1)
            lengths = np.where(off < best, s + on_leg, lengths)
            best = np.minimum(best, off)
        return lengths


@dataclass(frozen=True)
class Ring:
    """Full circle about centre (3,) mm, from u towards v, unit vectors (3,)."""

    name: PathName
    centre: Array
    u: Array
    v: Array
    radius_mm: float

    @property
    def length_mm(self) -> float:
        return 2 * float(np.pi) * self.radius_mm

    def at(self, s_mm: Array) -> Array:
        angle = np.asarray(s_mm)[:, None] / self.radius_mm
        return np.asarray(self.centre + self.radius_mm * (np.cos(angle) * self.u + np.sin(angle) * self.v))

    def nearest(self, places: Array) -> Array:
        """Lengths (n,) mm of the closest path points."""
        away = places - self.centre
        angle: Array = np.arctan2(away @ self.v, away @ self.u) % (2 * np.pi)
        return angle * self.radius_mm


CommandPath = Polygon | Ring


def paths_of(cube: Cube) -> dict[PathName, CommandPath]:
    """Paths of a cube in the order of each cycle. The path `back`, from the end of the line to its start
    over P3, is not evaluated.
    """
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
    """Paths in program order, each cycle repeated. The path `way`, between the cycles of two paths, is not
    evaluated.
    """
    paths, at = paths_of(cube), cube.places_mm[1]
    for names in _CYCLES:
        start = paths[names[0]].at(np.zeros(1))[0]
        if np.linalg.norm(start - at) > _SAME_MM:
            yield Polygon("way", np.array([at, start]))
        for name in names * cycles:
            yield paths[name]
        at = start


def joints_along(arm: Arm, cube: Cube, path: CommandPath, s_mm: Array, where: str) -> Array:
    """Joints (n, 6) rad with the tool at lengths s_mm (n,) of a path. Raises PathError if the arm cannot follow."""
    return follow(arm, cube.poses(path.at(s_mm)), cube.q[0], where)
