"""Emulated controller of a maker, and the joint motion of a program.

Its zeros and its model of the arm equal the rig file until corrections are entered. Moves are driven as a chain up to
the next stop at the programmed speed and acceleration, without corner rounding: joint moves in joint space, paths in
pose space.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from analysis.apps.makers import maker_by
from analysis.apps.makers.emulated import (
    ConfigurationFlags,
    Event,
    LinearMove,
    MoveLimits,
    OperatorPause,
    PointToPointMove,
    ProgramError,
    RegisterOutput,
    Round,
    Switched,
    ToolPose,
    Waited,
)
from analysis.robot.kinematics.arm import Arm, Array, arm_of, forward, reported_angles
from analysis.robot.kinematics.follow import follow
from analysis.robot.kinematics.inverse import inverse
from analysis.robot.kinematics.joint_limits import within_limits
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.vocabulary import MakerName

_SAME_SIZE = 1e-3
"""Tolerance in mm of a length at the controller, which is written with six digits."""


@dataclass(frozen=True)
class ControllerState:
    maker: MakerName
    arm: Arm
    reads_more: Array
    """Change (6,) of the joint readings in rad at an unchanged position."""

    @classmethod
    def of_rig(cls, rig: Rig, maker: MakerName) -> ControllerState:
        """Controller before any entry; it does not know the effects of the arm."""
        return cls(maker, arm_of(rig.robot), np.zeros(6))

    def flange(self, q: Array) -> tuple[Array, Array]:
        """Rotation (3, 3) and position (3,) in mm of the flange in the robot base at q (6,) in rad."""
        T = forward(self.with_tool(np.eye(4)), q[None])[0]
        return T[:3, :3], T[:3, 3]

    def with_tool(self, T_flange_tool: Array) -> Arm:
        """Arm as modelled by the controller, in the base of the robot, with a tool frame (4, 4) in mm."""
        return replace(self.arm, T_world_base=np.eye(4), T_flange_tool=T_flange_tool)

    def entered(self, corrections: Any, where: str) -> ControllerState:
        section = corrections.get("controller") if isinstance(corrections, Mapping) else None
        entries = section.get("entries") if isinstance(section, Mapping) else None
        if not isinstance(section, Mapping) or not isinstance(entries, Sequence) or isinstance(entries, str):
            problem, remedy = "has no entries for a controller", f"create the file with rig correct --for {self.maker}"
            raise FileError(where, problem, remedy, code="controller.invalid")
        if section.get("name") != self.maker:
            problem = f"is for a controller of {section.get('name')!r}, but this controller is of {self.maker!r}"
            remedy = f"create the file with rig correct --for {self.maker}"
            raise FileError(where, problem, remedy, code="robot.other")
        changed = self
        for number, entry in enumerate(entries, start=1):
            changed = changed._with(entry, self, f"{where}, entry {number}")
        return changed

    def _with(self, entry: Any, before: ControllerState, where: str) -> ControllerState:
        name, add, unit, now = (entry.get(key) if isinstance(entry, Mapping) else None for key in _KEYS)
        candidates = [
            (candidate, axis)
            for candidate in maker_by(self.maker).driver.parameters
            if (axis := candidate.axis_of(str(name)))
        ]
        if not candidates or candidates[0][1] > 6:
            problem = f"{str(name)!r} is not a parameter of a controller of {self.maker!r}"
            raise FileError(where, problem, "give the unchanged file of rig correct", code="controller.invalid")
        parameter, axis = candidates[0]
        number = isinstance(add, int | float) and not isinstance(add, bool) and math.isfinite(add)
        if unit != parameter.unit or not number:
            problem = f"{name} must be changed by a number in {parameter.unit}, not by {add!r} {unit!r}"
            raise FileError(where, problem, "give the unchanged file of rig correct", code="controller.invalid")
        change = parameter.factor * float(add or 0.0)
        if parameter.grows:
            stands = float(getattr(before.arm, parameter.field)[axis - 1])
            if isinstance(now, int | float) and abs(abs(stands) - now) > _SAME_SIZE * max(1.0, abs(now) * _SAME_SIZE):
                problem = f"{name} is {abs(stands):g} mm at this controller, but the file assumes {now:g} mm"
                remedy = "remove earlier entries, or repeat the correction for the nominal arm"
                raise FileError(where, problem, remedy, code="controller.invalid")
            change *= np.sign(stands)
        if parameter.unit == "deg" and parameter.field == "reading":  # set, after the entries before it
            change += float(before.reads_more[axis - 1] - self.reads_more[axis - 1])
        changes = np.zeros(6)
        changes[axis - 1] = change
        if parameter.field == "offset":  # of a drive, which may turn several axes, and counts backwards in some arms
            changes = self.arm.by_drives.coupling @ changes
        if parameter.field == "reading":
            return replace(self, reads_more=self.reads_more + reported_angles(self.arm, changes))
        arm = replace(self.arm, **{parameter.field: getattr(self.arm, parameter.field) + changes})
        return replace(self, arm=arm)


_KEYS = ("parameter", "add", "unit", "now")


_ARC_RAD, _LINE_MM, _TURN_RAD, _JOINT_RAD = np.radians([0.1, 1.0, 0.2, 0.5]) * [1, np.degrees(1), 1, 1]
"""Largest steps between two poses: on a circle of 70 mm joint interpolation deviates by 0.03 µm, on a line by less."""
_MM_S2 = 500.0
"""Default acceleration of the tool. Chosen: moderate, as near a gauge."""
_RAD_S = 1.0
_TO_SPEED_S = 0.3
_MM_PER_RAD = 500.0
"""Length equivalent of a rotation of the tool: the size of an arm."""
_MOST_SAMPLES = 3_000_000
"""Maximum number of samples. A program of an hour has a tenth of it."""
_SMALLEST_STEP = 1e-6
"""Size in mm or rad below which a step is only rounding in the program and not a move."""


@dataclass(frozen=True)
class DrivenMotion:
    t_s: Array
    q: Array
    holds_s: tuple[float, ...]
    outputs: tuple[tuple[float, int | str, bool], ...]
    registers: tuple[tuple[float, int, int], ...]


def drive(controller: ControllerState, events: Sequence[Event], near: Array, where: str) -> DrivenMotion:
    """Joint motion for the events of a program, which `where` names in errors.

    The arm starts at the first position, in the configuration closest to `near` (6,) in rad if only a pose is given.
    Raises FileError for impossible motions, and ProgramError for a program without moves.
    """
    driver = _Driver(controller, near, where)
    for event in events:
        driver.do(event)
    driver.finish_chain()
    if not driver.q:
        raise ProgramError("it moves nothing")
    t_s, q = np.concatenate(driver.t_s), np.concatenate(driver.q)
    return DrivenMotion(t_s, q, tuple(driver.holds_s), tuple(driver.outputs), tuple(driver.registers))


@dataclass
class _Driver:
    controller: ControllerState
    near: Array
    where: str
    t_s: list[Array] = field(default_factory=list)
    q: list[Array] = field(default_factory=list)
    samples: int = 0
    chain: list[LinearMove | Round] = field(default_factory=list)
    holds_s: list[float] = field(default_factory=list)
    outputs: list[tuple[float, int | str, bool]] = field(default_factory=list)
    registers: list[tuple[float, int, int]] = field(default_factory=list)

    @property
    def now_s(self) -> float:
        return float(self.t_s[-1][-1]) if self.t_s else 0.0

    def do(self, event: Event) -> None:
        if isinstance(event, LinearMove | Round):
            self.chain.append(event)
            if event.stops:
                self.finish_chain()
            return
        self.finish_chain()
        match event:
            case PointToPointMove():
                self.move_joints(event)
            case Waited(seconds) if seconds > 0 and self.q:
                self.add(np.array([seconds]), self.q[-1][-1:])
            case Switched(output, on):
                self.outputs.append((self.now_s, output, on))
            case RegisterOutput(register, value):
                self.registers.append((self.now_s, register, value))
            case OperatorPause():
                self.holds_s.append(self.now_s)

    def add(self, seconds: Array, q: Array) -> None:
        """Append a motion through joint angles q (n, 6) in rad at increasing relative times (n,) in s."""
        self.samples += len(q)
        _require_short(self.samples)
        self.t_s.append(self.now_s + seconds)
        self.q.append(q)

    def move_joints(self, event: PointToPointMove) -> None:
        arm = self.controller.with_tool(_frame(event.tool))
        at = self.q[-1][-1] if self.q else None
        end = event.q if event.q is not None else _solve_pose(arm, event.pose, self.near if at is None else at)
        outside = np.flatnonzero((end < arm.limits[:, 0] - _SMALLEST_STEP) | (end > arm.limits[:, 1] + _SMALLEST_STEP))
        if len(outside):
            axis = int(outside[0])
            raise ProgramError(f"axis {axis + 1} is sent to {np.degrees(end[axis]):.2f}°, beyond the limits")
        if at is None:
            self.t_s.append(np.zeros(1))
            self.q.append(end[None])
        elif (way := float(np.abs(end - at).max())) > _SMALLEST_STEP:
            seconds, accelerating = _joint_time(arm, at, end, event.speed)
            share = np.linspace(0, 1, 50 + int(way / _JOINT_RAD))
            times = _times(share, np.full(len(share) - 1, 1 / seconds), np.full(len(share) - 1, accelerating))
            times *= (event.speed.seconds or times[-1]) / times[-1]
            self.add(times[1:], (at + share[:, None] * (end - at))[1:])

    def finish_chain(self) -> None:
        moves = [move for move in self.chain if max(move.length_mm, move.turned_rad) > _SMALLEST_STEP]
        self.chain.clear()
        if not moves:
            return
        parts = [_part(move) for move in moves]
        poses, measures, speeds, accelerations = (np.concatenate(values) for values in zip(*parts, strict=True))
        _require_short(self.samples + len(poses))
        arm = self.controller.with_tool(_frame(moves[0].tool))
        begin = _frames(*moves[0].at(np.zeros(1)))
        q = follow(arm, np.concatenate([begin, poses]), self.q[-1][-1], self.where)
        times = _times(np.concatenate([[0.0], np.cumsum(measures)]), speeds, accelerations)
        if len(moves) == 1 and moves[0].speed.seconds:
            times *= moves[0].speed.seconds / times[-1]
        self.add(times[1:], q[1:])


def _require_short(samples: int) -> None:
    if samples > _MOST_SAMPLES:
        raise ProgramError("the program is too long for an emulated robot")


def _part(move: LinearMove | Round) -> tuple[Array, Array, Array, Array]:
    """Poses (n, 4, 4) of a move except the start, and of each step the size in mm including rotation, and the limits
    of speed and acceleration."""
    step_rad = _ARC_RAD if isinstance(move, Round) else _TURN_RAD
    count = max(3, int(np.ceil(max(move.turned_rad / step_rad, move.length_mm / _LINE_MM))))
    _require_short(count)
    share = np.linspace(0, 1, count + 1)[1:]
    turns = move.turned_rad if isinstance(move, LinearMove) else 0.0
    length = move.length_mm if move.length_mm > turns else _MM_PER_RAD * turns
    seconds = max(move.length_mm / move.speed_mm_s, turns / (move.speed.rad_s or _RAD_S))
    acceleration = move.speed.mm_s2 or _MM_S2
    each = np.full(count, length / count)
    return _frames(*move.at(share)), each, np.full(count, length / seconds), np.full(count, acceleration)


def _joint_time(arm: Arm, begin: Array, end: Array, speed: MoveLimits) -> tuple[float, float]:
    """Duration of a joint move at full speed in s, and the acceleration in moves per second²."""
    way = np.abs(end - begin)
    seconds = float((way / arm.speed).max()) / (speed.share or 1.0)
    if speed.axis_rad_s:
        seconds = max(seconds, float(way.max()) / speed.axis_rad_s)
    if speed.mm_s and speed.rad_s:
        poses = [ToolPose(T[:3, 3], Rotation.from_matrix(T[:3, :3])) for T in forward(arm, np.stack([begin, end]))]
        turned = float((poses[0].turn.inv() * poses[1].turn).magnitude())
        seconds = max(seconds, float(np.linalg.norm(poses[1].place - poses[0].place)) / speed.mm_s)
        seconds = max(seconds, turned / speed.rad_s)
    accelerating = speed.axis_rad_s2 / float(way.max()) if speed.axis_rad_s2 else 1 / (seconds * _TO_SPEED_S)
    return seconds, accelerating


def _times(way: Array, speeds: Array, accelerations: Array) -> Array:
    """Times (n,) in s of the fastest motion from rest to rest, at increasing positions way (n,).

    speeds, accelerations (n - 1,): limits of each step.
    """
    # Between two positions v² changes by at most 2 a ds, so the maximum speed is the minimum over all limits.
    gained = np.concatenate([[0.0], np.cumsum(2 * accelerations * np.diff(way))])
    square = np.minimum(np.concatenate([[0.0], speeds**2]), np.concatenate([speeds**2, [0.0]]))
    square = gained + np.minimum.accumulate(square - gained)
    square = np.minimum.accumulate((square + gained)[::-1])[::-1] - gained
    v = np.sqrt(np.maximum(square, 0.0))
    v[[0, -1]] = 0.0
    return np.concatenate([[0.0], np.cumsum(2 * np.diff(way) / (v[1:] + v[:-1]))])


def _solve_pose(arm: Arm, pose: ToolPose, near: Array) -> Array:
    """Joint angles (6,) in rad at a pose in the stated configuration, preferring those closest to `near`."""
    solutions = inverse(arm, _frame(pose)[None])
    allowed, _ = within_limits(arm, solutions.q[solutions.found])
    if not len(allowed):
        raise ProgramError(f"the position {pose.place.round(1).tolist()} mm is out of the arm's reach")
    stated = pose.configuration
    fitting = [q for q in allowed if stated is None or _configuration(q, stated) == stated]
    if not fitting:
        raise ProgramError(f"the arm cannot reach {pose.place.round(1).tolist()} mm in the stated configuration")
    nearest: Array = min(fitting, key=lambda q: float(np.abs(q - near).max()))
    return nearest


def _configuration(q: Array, stated: ConfigurationFlags) -> ConfigurationFlags:
    """Configuration at q (6,) in rad in the notation of `stated`: whether axes 4, 6 and 1 exceed 180°."""
    beyond = tuple(int(not -np.pi < q[axis] <= np.pi) for axis in (3, 5, 0))
    return ConfigurationFlags(bool(q[4] > 0), beyond if len(stated.counts) == len(beyond) else stated.counts)


def _frame(pose: ToolPose) -> Array:
    frame: Array = _frames(pose.place[None], Rotation.concatenate([pose.turn]))[0]
    return frame


def _frames(places: Array, turns: Rotation) -> Array:
    T = np.tile(np.eye(4), (len(places), 1, 1))
    T[:, :3, :3], T[:, :3, 3] = turns.as_matrix().reshape(-1, 3, 3), places
    return T
