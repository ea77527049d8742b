"""Motion plans of robot programs, independent of the language, and their demand on the arm.

Poses are tool poses in the robot's base frame: axis 1 along z, placed by `robot.base` of the rig file. Controllers use
this frame if no base or user frame is selected.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from analysis.robot.kinematics.arm import Arm, Array, forward
from analysis.robot.kinematics.newton import cancelling_axes, conditioning
from rigs.schema.feedback import Feedback
from rigs.schema.robot import LengthUnit
from rigs.text import counted

ZONE_MM = 0.3
"""Distance before the end of an arc at which the next may start, so that the tool does not stop. The corner deviates
from the circle by at most ZONE² / 2R: 0.6 µm at 70 mm. Some languages do not allow a smaller distance."""


@dataclass(frozen=True)
class PlannedTarget:
    T: Array
    q: Array


@dataclass(frozen=True)
class JointMove:
    target: PlannedTarget
    speed_rad_s: float
    """Maximum speed of any joint."""


@dataclass(frozen=True)
class StraightMove:
    target: PlannedTarget
    speed_mm_s: float
    stops: bool = True
    """False if the next line or arc continues at the same speed."""
    q: Array = field(kw_only=True)
    """Joint angles (n, 6) rad at equal distances, including both ends; also of the other moves."""


@dataclass(frozen=True)
class ToolRotation:
    """A rotation of the tool about its origin by `angle` rad, with a stop at the target."""

    target: PlannedTarget
    angle: float
    speed_rad_s: float
    q: Array = field(kw_only=True)


@dataclass(frozen=True)
class Arc:
    """A move of the tool on the circle through `via` to `end`."""

    via: PlannedTarget
    end: PlannedTarget
    speed_mm_s: float
    stops: bool = True
    with_path: bool = False
    """True if the tool keeps its orientation to the path. Otherwise it rotates evenly to that of the end."""
    q: Array = field(kw_only=True)


@dataclass(frozen=True)
class Dwell:
    seconds: float


@dataclass(frozen=True)
class Signal:
    """The number shown by the robot, which makes the daemon start and end runs; 0 for none."""

    value: int


@dataclass(frozen=True)
class Hold:
    """A pause until the operator continues the program."""

    request: str


@dataclass(frozen=True)
class Comment:
    text: str


Move = JointMove | StraightMove | ToolRotation | Arc
Step = Move | Dwell | Signal | Hold | Comment


@dataclass(frozen=True)
class SignalPlace:
    """The outputs or the register with the signal; neither if the rig file needs none."""

    outputs: tuple[int, ...] = ()
    """Digital outputs read as a binary number, least significant bit first."""
    int_register: int | None = None

    def bits(self, value: int) -> list[tuple[int, bool]]:
        return [(number, bool(value >> place & 1)) for place, number in enumerate(self.outputs)]


@dataclass(frozen=True)
class MotionPlan:
    name: str
    arm: Arm
    payload_kg: float
    ball_mm: Array
    """Nominal centre (3,) of the base-ball in the robot's base frame."""
    signal_place: SignalPlace
    feedback: Feedback
    steps: tuple[Step, ...]
    length_unit: LengthUnit | None = None
    """Unit of the lengths in the controller, if the rig file states it."""
    has_link: bool = True
    """False if the target of a tracker is mounted instead of a ball link."""
    full_turns: tuple[int, ...] = ()
    """Full turns of each joint between the posture that the rig file states for the lap and the lap as driven."""


def percent_of_axes(arm: Arm, speed_rad_s: float) -> int:
    """Largest whole percentage of the axis speeds at which no axis exceeds speed_rad_s."""
    return max(1, min(100, int(100 * speed_rad_s / float(arm.speed.max()))))


def end_of(move: Move) -> PlannedTarget:
    return move.end if isinstance(move, Arc) else move.target


def start_of(plan: MotionPlan) -> PlannedTarget:
    return next(end_of(step) for step in plan.steps if isinstance(step, Move))


def turns_with_path(plan: MotionPlan) -> bool:
    """True if the tool keeps its orientation to the arcs of a plan; all arcs are alike."""
    return any(step.with_path for step in plan.steps if isinstance(step, Arc))


def in_base(arm: Arm, poses: Array) -> Array:
    """Convert poses (n, 4, 4) in the world frame to the robot's base frame."""
    inside: Array = np.linalg.inv(arm.T_world_base) @ poses
    return inside


_STEP_RAD = np.radians(2.0)
"""Rotation of the fastest joint between samples of a joint move."""
_FULL_TURN_DEG = 300.0
"""Range above which a joint may wind up cables and hoses, nearly a full turn. Chosen."""
_NEAR_SINGULAR = 0.02
"""Conditioning below which a path is reported as nearly singular: a tenth of that of the shipped circles."""


@dataclass(frozen=True)
class Demand:
    """The demand of a plan on the arm after it has reached the start."""

    low: Array
    """Lowest angle (6,) rad of each joint; also `high`."""
    high: Array
    travel: Array
    least_conditioning: float
    """At the joint angles `q_there` (6,) rad."""
    q_there: Array
    box_mm: Array
    """Lowest and highest tool coordinates (2, 3) in the base frame."""
    distance_mm: Array
    """Least and greatest distance (2,) from the base-ball while the link is mounted."""
    removals: int
    """Joint moves for which the operator removes the link."""


def demand_of(plan: MotionPlan) -> Demand:
    arm = plan.arm
    moves = [step for step in plan.steps if isinstance(step, Move)]
    pieces = [angles_along(end_of(before), move) for before, move in pairwise(moves)]
    link = [not isinstance(move, JointMove) for move in moves[1:]]
    q = np.concatenate([start_of(plan).q[None], *pieces])
    places = in_base(arm, forward(arm, q))[:, :3, 3]
    with_link = np.repeat([True, *link], [1, *map(len, pieces)])
    distance = np.linalg.norm(places - plan.ball_mm, axis=1)[with_link]
    even = conditioning(arm, q)
    worst = int(even.argmin())
    return Demand(
        low=q.min(axis=0),
        high=q.max(axis=0),
        travel=np.abs(np.diff(q, axis=0)).sum(axis=0),
        least_conditioning=float(even[worst]),
        q_there=q[worst],
        box_mm=np.stack([places.min(axis=0), places.max(axis=0)]),
        distance_mm=np.array([distance.min(), distance.max()]),
        removals=link.count(False),
    )


def angles_along(begin: PlannedTarget, move: Move) -> Array:
    if not isinstance(move, JointMove):
        return move.q[1:]
    count = 1 + int(np.abs(move.target.q - begin.q).max() / _STEP_RAD)
    joints: Array = begin.q + np.linspace(0, 1, count + 1)[1:, None] * (move.target.q - begin.q)
    return joints


def seconds_of(plan: MotionPlan) -> float:
    """Duration in s from the start position, excluding pauses for the operator."""
    at, seconds = start_of(plan), 0.0
    for step in plan.steps:
        if isinstance(step, Dwell):
            seconds += step.seconds
        elif isinstance(step, JointMove):
            seconds += float(np.abs(step.target.q - at.q).max() / step.speed_rad_s)
        elif isinstance(step, ToolRotation):
            seconds += step.angle / step.speed_rad_s
        elif isinstance(step, Move):
            q = np.concatenate([at.q[None], angles_along(at, step)])
            places = in_base(plan.arm, forward(plan.arm, q))[:, :3, 3]
            seconds += float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum()) / step.speed_mm_s
        if isinstance(step, Move):
            at = end_of(step)
    return seconds


def demand_lines(plan: MotionPlan, demand: Demand, names: list[str]) -> list[str]:
    """Describe the demand in words. names (6): of the axes."""
    start = np.degrees(start_of(plan).q)
    low, high, travel = np.degrees(demand.low), np.degrees(demand.high), np.degrees(demand.travel)
    room = np.degrees(np.minimum(demand.low - plan.arm.limits[:, 0], plan.arm.limits[:, 1] - demand.high))
    tight = int(room.argmin())
    lines = [
        f"within the limits; smallest margin: {names[tight]}, {room[tight]:.0f}°",
        f"smallest conditioning {demand.least_conditioning:.2g} (0 is a singularity)",
    ]
    if plan.has_link:
        low_mm, high_mm = demand.distance_mm
        lines.append(f"the tool stays {low_mm:.2f} … {high_mm:.2f} mm from the base-ball")
    if demand.least_conditioning < _NEAR_SINGULAR:
        axes = ", ".join(map(str, cancelling_axes(plan.arm, demand.q_there)))
        lines[1] += f": nearly singular, because axes {axes} cancel each other; watch the first run"
    if demand.removals and plan.has_link:
        lines.append(
            f"remove the link {demand.removals} times, because a singularity prevents the arm from following the sphere"
        )
    lines += [
        f"the lap fits the limits only {counted(abs(turns), 'full turn')} away from posture_deg: {names[axis]} starts "
        f"at {start[axis]:z.0f}° and unwinds on the way there; make room for cables and hoses"
        for axis, turns in enumerate(plan.full_turns)
        if turns
    ]
    lines += [
        f"{names[axis]} turns from {low[axis]:z.0f}° to {high[axis]:z.0f}°, {travel[axis] / 360:z.1f} turns "
        "in total: route cables and hoses accordingly"
        for axis in np.flatnonzero(high - low > _FULL_TURN_DEG)
    ]
    return lines
