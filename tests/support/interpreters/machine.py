"""The robot behind an interpreter: it moves as its controller would, and remembers everything that it did.

Lengths mm, angles rad; a place is the tool's (3,), an orientation a scipy Rotation, both in the robot's base frame. The
machine gets its arm as a function from joint angles to the flange, and its tool as the program or a person sets it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
Flange = Callable[[Array], tuple[Array, Array]]
"""Rotation (3, 3) and place (3,) mm of the flange at joint angles (6,) rad."""
Turning = Literal["fixed to path", "relative to path", "even", "angles"]
"""How a controller turns the tool along an arc: fixed to the path from where it stands; from beginning to end relative
to the path; about one axis in space; or each of its three angles by itself."""


class ProgramError(Exception):
    """A controller would refuse this program."""


@dataclass(frozen=True)
class Posture:
    """What a position says of the arm's posture, in words that follow from the joint angles alone.

    flip: axis 5 stands at a positive angle; counts: of axes 4, 5 and 6 or of 4, 6 and 1, as the language has them.
    """

    flip: bool
    counts: tuple[int, ...]


@dataclass(frozen=True)
class Pose:
    place: Array
    turn: Rotation
    posture: Posture | None = None


@dataclass(frozen=True)
class Stood:
    """A joint move, or one to a pose, that ended here."""

    pose: Pose
    q: Array | None


@dataclass(frozen=True)
class Straight:
    begin: Pose
    end: Pose
    speed_mm_s: float
    stops: bool

    @property
    def length_mm(self) -> float:
        return float(np.linalg.norm(self.end.place - self.begin.place))

    def at(self, share: Array) -> tuple[Array, Rotation]:
        places = self.begin.place + share[:, None] * (self.end.place - self.begin.place)
        return places, _evenly(self.begin.turn, self.end.turn, share)


@dataclass(frozen=True)
class Round:
    """An arc about a unit axis (3,) through a centre (3,), by an angle in rad."""

    begin: Pose
    end: Pose
    centre: Array
    axis: Array
    angle: float
    turning: Turning
    speed_mm_s: float
    stops: bool

    @property
    def length_mm(self) -> float:
        return self.angle * float(np.linalg.norm(self.begin.place - self.centre))

    def at(self, share: Array) -> tuple[Array, Rotation]:
        around = Rotation.from_rotvec(self.angle * share[:, None] * self.axis)
        return self.centre + around.apply(self.begin.place - self.centre), self._turned(around, share)

    def _turned(self, around: Rotation, share: Array) -> Rotation:
        begin, end = self.begin.turn, self.end.turn
        match self.turning:
            case "fixed to path":
                return around * begin
            case "relative to path":
                whole = Rotation.from_rotvec(self.angle * self.axis)
                return around * _evenly(begin, whole.inv() * end, share)
            case "even":
                return _evenly(begin, end, share)
        first, last = begin.as_euler("xyz"), end.as_euler("xyz")
        way = (last - first + np.pi) % (2 * np.pi) - np.pi
        return Rotation.from_euler("xyz", first + share[:, None] * way)


@dataclass(frozen=True)
class Waited:
    seconds: float


@dataclass(frozen=True)
class Switched:
    output: int | str
    on: bool


@dataclass(frozen=True)
class Shown:
    register: int
    value: int


@dataclass(frozen=True)
class Held:
    """The program waited for a person."""


Event = Stood | Straight | Round | Waited | Switched | Shown | Held


def _evenly(begin: Rotation, end: Rotation, share: Array) -> Rotation:
    vector = (end * begin.inv()).as_rotvec()
    return Rotation.from_rotvec(share[:, None] * vector) * begin


def circle_through(a: Array, b: Array, c: Array) -> tuple[Array, Array, float]:
    """Centre, axis and angle of the arc from a through b to c: the point of the plane that is as far from each."""
    normal = np.cross(b - a, c - b)
    if np.linalg.norm(normal) < 1e-6:
        raise ProgramError("the points of an arc lie on a line")
    axis = normal / np.linalg.norm(normal)
    planes = np.stack([b - a, c - a, axis])
    centre = np.linalg.solve(planes, [(b @ b - a @ a) / 2, (c @ c - a @ a) / 2, axis @ a])
    u = (a - centre) / np.linalg.norm(a - centre)
    angles = [np.arctan2((p - centre) @ np.cross(axis, u), (p - centre) @ u) % (2 * np.pi) for p in (b, c)]
    if not 0 < angles[0] < angles[1]:
        raise ProgramError("the middle of an arc is not between its ends")
    return centre, axis, float(angles[1])


class Machine:
    """An arm with a tool, and what it did."""

    def __init__(self, flange: Flange, tool: Pose | None = None) -> None:
        self._flange = flange
        self.tool = tool
        self.events: list[Event] = []
        self._pose: Pose | None = None

    @property
    def pose(self) -> Pose:
        if self._pose is None:
            raise ProgramError("the program moves on a path before it has been anywhere")
        return self._pose

    def joints(self, q: Array) -> None:
        if q.shape != (6,) or not np.isfinite(q).all():
            raise ProgramError(f"{q} are not six joint angles")
        if self.tool is None:
            raise ProgramError("the program moves before it has a tool")
        matrix, place = self._flange(q)
        turn = Rotation.from_matrix(matrix)
        self._pose = Pose(place + turn.apply(self.tool.place), turn * self.tool.turn)
        self.events.append(Stood(self._pose, q))

    def go(self, pose: Pose) -> None:
        self._pose = pose
        self.events.append(Stood(pose, None))

    def line(self, pose: Pose, speed_mm_s: float, *, stops: bool) -> None:
        self.events.append(Straight(self.pose, pose, _speed(speed_mm_s), stops))
        self._pose = pose

    def turn(self, pose: Pose, speed_rad_s: float) -> None:
        """About the tool's origin; a speed of turning is no speed for a way."""
        if np.linalg.norm(pose.place - self.pose.place) > 0.01 or not 0 < speed_rad_s < 10:
            raise ProgramError("a turn has the speed of a turn, and no way")
        self.line(pose, 1.0, stops=True)

    def arc(self, via: Array, end: Pose, speed_mm_s: float, *, turning: Turning, stops: bool) -> None:
        begin = self.pose
        centre, axis, angle = circle_through(begin.place, via, end.place)
        driven = Round(begin, end, centre, axis, angle, turning, _speed(speed_mm_s), stops)
        self.events.append(driven)
        self._pose = Pose(end.place, driven.at(np.ones(1))[1][0])


def _speed(speed_mm_s: float) -> float:
    if not 0 < speed_mm_s < 3000:
        raise ProgramError(f"{speed_mm_s} mm/s is no speed of a robot")
    return speed_mm_s
