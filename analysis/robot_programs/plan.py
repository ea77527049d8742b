"""A plan of motion that knows no dialect: what a robot program does, step by step.

Every dialect renders the same plan, and limits, singularities and turns are checked on it. Poses are those of the tool
in the robot's base frame (axis 1 along z, as the rig file's `robot.base` places it), which is the frame a controller
without a base or user frame counts in.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from analysis.kinematics.arm import Arm, Array
from rigs.schema.feedback import Feedback

ZONE_MM = 0.3
"""How far before the end of an arc the next may begin, so that the tool does not stop between arcs of one circle. The
corner that a controller cuts is within ZONE² / 2R of the circle: 0.6 µm at 70 mm. Some languages have no smaller."""
ACCELERATION_MM_S2 = 200.0
"""Acceleration on arcs and lines; that of the simulated laps (analysis/geometry/programs.py)."""


@dataclass(frozen=True)
class Target:
    """A pose T_base_tool (4, 4), place in mm, and the joint angles q (6,) rad at which the arm stands there."""

    T: Array
    q: Array


@dataclass(frozen=True)
class JointMove:
    """All joints together to a target and a stop there; no joint moves faster than speed_rad_s."""

    target: Target
    speed_rad_s: float


@dataclass(frozen=True)
class Line:
    """The tool straight to a target, the arm's posture kept; stops: there, otherwise the next line continues at the
    same speed. q (n, 6) rad: the joint angles at even distances along it, ends included."""

    target: Target
    speed_mm_s: float
    stops: bool = True
    q: Array = field(kw_only=True)


@dataclass(frozen=True)
class Turn:
    """The tool turned about its origin, by an angle, to a target and a stop there; q as that of a line."""

    target: Target
    angle: float
    speed_rad_s: float
    q: Array = field(kw_only=True)


@dataclass(frozen=True)
class Arc:
    """The tool on the circle through `via` to `end`.

    with_path: it keeps its orientation to the path, so that it turns about the circle's axis by as much as it goes
    around it; otherwise it turns evenly to that of the end. stops: at the end; otherwise the next arc continues at
    the same speed. q as that of a line.
    """

    via: Target
    end: Target
    speed_mm_s: float
    stops: bool = True
    with_path: bool = False
    q: Array = field(kw_only=True)


@dataclass(frozen=True)
class Dwell:
    """The robot stands."""

    seconds: float


@dataclass(frozen=True)
class Signal:
    """The number that the robot shows from here on, by which the daemon starts and ends runs; 0 for none."""

    value: int


@dataclass(frozen=True)
class Hold:
    """The program waits until a person has done something and continues it."""

    request: str


@dataclass(frozen=True)
class Comment:
    """A line for a person who reads the program."""

    text: str


Move = JointMove | Line | Turn | Arc
Step = Move | Dwell | Signal | Hold | Comment


@dataclass(frozen=True)
class SignalPlace:
    """Where the controller shows its number: digital outputs read as a binary number, the first is the least, or an
    integer register; neither where the rig file asks for no signal."""

    outputs: tuple[int, ...] = ()
    int_register: int | None = None

    def bits(self, value: int) -> list[tuple[int, bool]]:
        """Each output with its state while the robot shows `value`."""
        return [(number, bool(value >> place & 1)) for place, number in enumerate(self.outputs)]


@dataclass(frozen=True)
class Plan:
    """A program before it is written.

    name: test, direction and rig; ball_mm (3,): the base-ball's nominal centre in the robot's base frame; has_link:
    whether a ball link is on, or a tracker's target.
    """

    name: str
    arm: Arm
    payload_kg: float
    ball_mm: Array
    signal_place: SignalPlace
    feedback: Feedback
    steps: tuple[Step, ...]
    has_link: bool = True


def percent_of_axes(arm: Arm, speed_rad_s: float) -> int:
    """Largest whole percentage of the axes' greatest speeds at which no axis moves faster than speed_rad_s."""
    return max(1, min(100, int(100 * speed_rad_s / float(arm.speed.max()))))


def end_of(move: Move) -> Target:
    """Where a move ends."""
    return move.end if isinstance(move, Arc) else move.target


def start_of(plan: Plan) -> Target:
    """The first target of a plan."""
    return next(end_of(step) for step in plan.steps if isinstance(step, Move))


def turns_with_path(plan: Plan) -> bool:
    """Whether the tool keeps its orientation to the arcs of a plan, which are all alike."""
    return any(step.with_path for step in plan.steps if isinstance(step, Arc))


def in_base(arm: Arm, poses: Array) -> Array:
    """Poses (n, 4, 4) of the world, places in mm, in the robot's base frame."""
    inside: Array = np.linalg.inv(arm.T_world_base) @ poses
    return inside
