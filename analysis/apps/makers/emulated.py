"""Emulated controllers: an interpreter drives a robot as the controller would, and records all actions.

Lengths are in mm, angles in rad. Positions (3,) and orientations are those of the tool in the robot's base frame.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
Flange = Callable[[Array], tuple[Array, Array]]
"""Function from joint angles (6,) rad to rotation (3, 3) and position (3,) mm of the flange."""
Turning = Literal["fixed to path", "relative to path", "even"]
"""Rotation of the tool along an arc: with the path; from start to end relative to the path; or about a fixed axis."""
_FARTHEST_MM = 1e5
"""Limit of a coordinate: ten times the reach of any arm."""
_FASTEST_MM_S, _FASTEST_RAD_S = 3000.0, 10.0
"""Speed limits, far above the speed of arms carrying a gauge."""
_SAME_MM, _SAME_RAD = 1e-6, 1e-9


COUNTS_PER_DEG = 3000.0
"""Counts, or pulses, per degree of an axis of an emulated arm. Chosen: no maker publishes the number."""
GEAR_RATIO = 100.0
Field = Literal["reading", "offset", "a", "d", "alpha"]


class ProgramError(Exception):
    """The emulated controller rejects a program."""


@dataclass(frozen=True)
class ConfigurationFlags:
    flip: bool
    counts: tuple[int, ...]
    """Turns of axes 4, 5 and 6 or of 4, 6 and 1, as used by the language."""


@dataclass(frozen=True)
class ToolPose:
    place: Array
    turn: Rotation
    configuration: ConfigurationFlags | None = None


@dataclass(frozen=True)
class MoveLimits:
    """Limits of a move; None if the language sets none."""

    share: float | None = None
    """Share of the maximum speed of each axis, 0 to 1."""
    axis_rad_s: float | None = None
    axis_rad_s2: float | None = None
    mm_s: float | None = None
    rad_s: float | None = None
    mm_s2: float | None = None
    seconds: float | None = None
    """Duration of the move, which overrides the other limits."""


NO_LIMITS = MoveLimits()


@dataclass(frozen=True)
class PointToPointMove:
    """A joint move of a tool to joint angles q (6,) rad or to a pose."""

    pose: ToolPose
    q: Array | None
    tool: ToolPose
    speed: MoveLimits


@dataclass(frozen=True)
class LinearMove:
    begin: ToolPose
    end: ToolPose
    speed_mm_s: float
    stops: bool
    tool: ToolPose
    speed: MoveLimits

    @property
    def length_mm(self) -> float:
        return float(np.linalg.norm(self.end.place - self.begin.place))

    @property
    def turned_rad(self) -> float:
        return float((self.end.turn * self.begin.turn.inv()).magnitude())

    def at(self, share: Array) -> tuple[Array, Rotation]:
        """Positions (n, 3) mm and orientations at fractions (n,) of the path."""
        places = self.begin.place + share[:, None] * (self.end.place - self.begin.place)
        return places, _evenly(self.begin.turn, self.end.turn, share)


@dataclass(frozen=True)
class Round:
    """An arc of a tool by an angle in rad about a unit axis (3,) through a centre (3,) mm."""

    begin: ToolPose
    end: ToolPose
    centre: Array
    axis: Array
    angle: float
    turning: Turning
    speed_mm_s: float
    stops: bool
    tool: ToolPose
    speed: MoveLimits

    @property
    def length_mm(self) -> float:
        return self.angle * float(np.linalg.norm(self.begin.place - self.centre))

    @property
    def turned_rad(self) -> float:
        return self.angle

    def at(self, share: Array) -> tuple[Array, Rotation]:
        around = Rotation.from_rotvec(self.angle * share[:, None] * self.axis)
        begin, end = self.begin.turn, self.end.turn
        match self.turning:
            case "fixed to path":
                turn = around * begin
            case "relative to path":
                whole = Rotation.from_rotvec(self.angle * self.axis)
                turn = around * _evenly(begin, whole.inv() * end, share)
            case _:
                turn = _evenly(begin, end, share)
        return self.centre + around.apply(self.begin.place - self.centre), turn


@dataclass(frozen=True)
class Waited:
    seconds: float


@dataclass(frozen=True)
class Switched:
    output: int | str
    on: bool


@dataclass(frozen=True)
class RegisterOutput:
    register: int
    value: int


@dataclass(frozen=True)
class OperatorPause:
    """The program waits for the operator."""


Event = PointToPointMove | LinearMove | Round | Waited | Switched | RegisterOutput | OperatorPause


def _evenly(begin: Rotation, end: Rotation, share: Array) -> Rotation:
    vector = (end * begin.inv()).as_rotvec()
    return Rotation.from_rotvec(share[:, None] * vector) * begin


def circle_through(a: Array, b: Array, c: Array) -> tuple[Array, Array, float]:
    """Centre (3,), axis (3,) and angle of the arc from a (3,) through b to c. Raises ProgramError if there is none."""
    normal = np.cross(b - a, c - b)
    if np.linalg.norm(normal) < 1e-6:
        raise ProgramError("the points of an arc lie on a straight line")
    axis = normal / np.linalg.norm(normal)
    planes = np.stack([b - a, c - a, axis])
    centre = np.linalg.solve(planes, [(b @ b - a @ a) / 2, (c @ c - a @ a) / 2, axis @ a])
    u = (a - centre) / np.linalg.norm(a - centre)
    angles = [np.arctan2((p - centre) @ np.cross(axis, u), (p - centre) @ u) % (2 * np.pi) for p in (b, c)]
    if not 0 < angles[0] < angles[1]:
        raise ProgramError("the middle of an arc is not between the ends")
    return centre, axis, float(angles[1])


class Machine:
    def __init__(self, flange: Flange, tool: ToolPose | None = None) -> None:
        self._flange = flange
        self._tool = tool
        self.events: list[Event] = []
        self._pose: ToolPose | None = None

    @property
    def pose(self) -> ToolPose:
        """Pose of the tool. Raises ProgramError before the first move."""
        if self._pose is None:
            raise ProgramError("the program starts with a path move, before the first joint move")
        return self._pose

    @property
    def tool(self) -> ToolPose:
        """Tool in the flange's frame. Raises ProgramError if no tool is set."""
        if self._tool is None:
            raise ProgramError("the program moves before setting a tool")
        return self._tool

    @tool.setter
    def tool(self, tool: ToolPose) -> None:
        old, self._tool = self._tool, _finite(tool)
        if not old or not self._pose:
            return
        away_mm, turned = np.abs(old.place - tool.place).max(), (old.turn.inv() * tool.turn).magnitude()
        if away_mm >= _SAME_MM or turned >= _SAME_RAD:
            turn = self._pose.turn * old.turn.inv()
            self._pose = ToolPose(self._pose.place + turn.apply(tool.place - old.place), turn * tool.turn)

    def joints(self, q: Array, speed: MoveLimits) -> None:
        if np.shape(q) != (6,) or not np.isfinite(q).all():
            raise ProgramError("a joint move needs six joint angles")
        matrix, place = self._flange(q)
        turn = Rotation.from_matrix(matrix)
        self._pose = ToolPose(place + turn.apply(self.tool.place), turn * self.tool.turn)
        self.events.append(PointToPointMove(self._pose, q, self.tool, speed))

    def go(self, pose: ToolPose, speed: MoveLimits) -> None:
        self._pose = _finite(pose)
        self.events.append(PointToPointMove(pose, None, self.tool, speed))

    def line(self, pose: ToolPose, speed_mm_s: float, *, stops: bool, speed: MoveLimits = NO_LIMITS) -> None:
        self.events.append(LinearMove(self.pose, _finite(pose), _speed(speed_mm_s), stops, self.tool, speed))
        self._pose = pose

    def turn(self, pose: ToolPose, speed_rad_s: float) -> None:
        """Turn about the tool's origin to a pose, at a speed in rad/s. Raises ProgramError if the origin moves."""
        if np.linalg.norm(pose.place - self.pose.place) > 0.01 or not 0 < speed_rad_s < _FASTEST_RAD_S:
            raise ProgramError("a rotation has an angular speed and no path")
        self.line(pose, _FASTEST_MM_S / 2, stops=True, speed=MoveLimits(rad_s=speed_rad_s))

    def arc(
        self,
        via: Array,
        end: ToolPose,
        speed_mm_s: float,
        *,
        turning: Turning,
        stops: bool,
        speed: MoveLimits = NO_LIMITS,
    ) -> None:
        """Move the tool on the arc through a position `via` (3,) mm to a pose."""
        begin = self.pose
        centre, axis, angle = circle_through(begin.place, via, _finite(end).place)
        way = Round(begin, end, centre, axis, angle, turning, _speed(speed_mm_s), stops, self.tool, speed)
        self.events.append(way)
        self._pose = ToolPose(end.place, way.at(np.ones(1))[1][0])

    def wait(self, seconds: float) -> None:
        if not 0 <= seconds < np.inf:
            raise ProgramError(f"{seconds} s is not a valid waiting time")
        self.events.append(Waited(seconds))


def _finite(pose: ToolPose) -> ToolPose:
    if not isinstance(pose, ToolPose):
        raise ProgramError("the target of a path has to be a pose")
    if not np.abs(pose.place).max() < _FARTHEST_MM or not np.isfinite(pose.turn.as_quat()).all():
        raise ProgramError(f"{pose.place} mm is not a valid position of an arm")
    return pose


def _speed(speed_mm_s: float) -> float:
    if not 0 < speed_mm_s < _FASTEST_MM_S:
        raise ProgramError(f"{speed_mm_s} mm/s is not a valid robot speed")
    return speed_mm_s


@dataclass(frozen=True)
class ControllerParameter:
    """A parameter at the controller; {axis} in its name is the number of a joint, from 1."""

    name: str
    unit: str
    field: Field
    factor: float
    """mm or rad per unit."""
    later: int = 0
    """Axis number in the rig file minus axis number at the controller."""
    axis: int = 0
    """From 1, if the name contains no axis."""
    grows: bool = False

    def axis_of(self, name: str) -> int | None:
        """Axis of the rig file, from 1, for a name of this parameter; None for any other name."""
        match = re.fullmatch(re.escape(self.name).replace(r"\{axis\}", "([0-6])"), name)
        axis = (self.axis or int(match[1]) + self.later) if match else 0
        return axis if 1 <= axis <= 6 else None


READING = ControllerParameter("reading of axis {axis}", "deg", "reading", math.radians(1))
"""The reading of an axis, set in the menus of the maker by an operator without the counts per degree."""


@dataclass(frozen=True)
class ProgramDriver:
    run: Callable[[str, str, Machine], None]
    """Executes the texts of a program and its data list. Raises ProgramError if the controller would reject them."""
    parameters: tuple[ControllerParameter, ...]
    tool_entered: bool = False
    """True if the operator enters the tool, because the program does not set it."""
