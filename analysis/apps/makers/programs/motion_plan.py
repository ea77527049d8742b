"""A plan of motion that knows no dialect: what a robot program does, step by step, and what that asks of the arm before
anything is written: limits, singularities, turns of the wrist, room.

Every dialect renders the same plan, and limits, singularities and turns are checked on it. Poses are those of the tool
in the robot's base frame (axis 1 along z, as the rig file's `robot.base` places it), which is the frame a controller
without a base or user frame counts in.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from analysis.robot.kinematics.arm import Arm, Array, forward
from analysis.robot.kinematics.newton import cancelling_axes, conditioning
from rigs.schema.feedback import Feedback

ZONE_MM = 0.3
"""How far before the end of an arc the next may begin, so that the tool does not stop between arcs of one circle. The
corner that a controller cuts is within ZONE² / 2R of the circle: 0.6 µm at 70 mm. Some languages have no smaller."""
ACCELERATION_MM_S2 = 200.0
"""Acceleration on arcs and lines; that of the simulated laps (analysis/robot/geometry/driven_programs.py)."""


@dataclass(frozen=True)
class Target:
    """A pose T_base_tool (4, 4), position in mm, and the joint angles q (6,) rad of the arm there."""

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
    """A stop of the robot for a time."""

    seconds: float


@dataclass(frozen=True)
class Signal:
    """The number that the robot shows from here on, by which the daemon starts and ends runs; 0 for none."""

    value: int


@dataclass(frozen=True)
class Hold:
    """A pause until the operator continues the program."""

    request: str


@dataclass(frozen=True)
class Comment:
    """A comment for the reader of the program."""

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
        """Return each output with the state representing `value`."""
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
    """Return the final target of a move."""
    return move.end if isinstance(move, Arc) else move.target


def start_of(plan: Plan) -> Target:
    """Return the first target of a plan."""
    return next(end_of(step) for step in plan.steps if isinstance(step, Move))


def turns_with_path(plan: Plan) -> bool:
    """Return whether the tool keeps a constant orientation to the arcs of a plan, which are all alike."""
    return any(step.with_path for step in plan.steps if isinstance(step, Arc))


def in_base(arm: Arm, poses: Array) -> Array:
    """Return poses (n, 4, 4) of the world, positions in mm, in the robot's base frame."""
    inside: Array = np.linalg.inv(arm.T_world_base) @ poses
    return inside


_STEP_RAD = np.radians(2.0)
"""Rotation of the fastest joint between two samples of a joint move."""
_FULL_TURN_DEG = 300.0
"""A joint that swings by more winds its cables and hoses by nearly a turn. Chosen."""
_NEAR_SINGULAR = 0.02
"""Conditioning below which a path is reported as near a singularity, a tenth of what the shipped circles have."""


@dataclass(frozen=True)
class Demand:
    """What a plan asks of the arm once it stands at the start.

    low, high, travel (6,) rad: lowest and highest angle and the way of each joint; least_conditioning, at q_there (6,)
    rad; box_mm (2, 3): lowest and highest place of the tool in the base frame; distance_mm (2,): least and greatest
    from the base-ball while the link is on; removals: how often a person takes it off for a joint move.
    """

    low: Array
    high: Array
    travel: Array
    least_conditioning: float
    q_there: Array
    box_mm: Array
    distance_mm: Array
    removals: int


def demand_of(plan: Plan) -> Demand:
    """Compute the demand of a plan on the arm."""
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


def angles_along(begin: Target, move: Move) -> Array:
    """Return the joint angles (n, 6) rad along a move, excluding the start."""
    if not isinstance(move, JointMove):
        return move.q[1:]
    count = 1 + int(np.abs(move.target.q - begin.q).max() / _STEP_RAD)
    joints: Array = begin.q + np.linspace(0, 1, count + 1)[1:, None] * (move.target.q - begin.q)
    return joints


def seconds_of(plan: Plan) -> float:
    """Return the duration of a program in s, from the start position, excluding pauses for the operator."""
    at, seconds = start_of(plan), 0.0
    for step in plan.steps:
        if isinstance(step, Dwell):
            seconds += step.seconds
        elif isinstance(step, JointMove):
            seconds += float(np.abs(step.target.q - at.q).max() / step.speed_rad_s)
        elif isinstance(step, Turn):
            seconds += step.angle / step.speed_rad_s
        elif isinstance(step, Move):
            q = np.concatenate([at.q[None], angles_along(at, step)])
            places = in_base(plan.arm, forward(plan.arm, q))[:, :3, 3]
            seconds += float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum()) / step.speed_mm_s
        if isinstance(step, Move):
            at = end_of(step)
    return seconds


def demand_lines(plan: Plan, demand: Demand, names: list[str]) -> list[str]:
    """The demand in words; `names` (6) of the axes."""
    low, high, travel = np.degrees(demand.low), np.degrees(demand.high), np.degrees(demand.travel)
    room = np.degrees(np.minimum(demand.low - plan.arm.limits[:, 0], plan.arm.limits[:, 1] - demand.high))
    tight = int(room.argmin())
    lines = [
        f"within the limits; {names[tight]} comes nearest to one, {room[tight]:.0f}° from it",
        f"conditioning {demand.least_conditioning:.2g} where it is least (0 is a singularity)",
    ]
    if plan.has_link:
        low_mm, high_mm = demand.distance_mm
        lines.append(f"the tool stays {low_mm:.2f} … {high_mm:.2f} mm from the base-ball")
    if demand.least_conditioning < _NEAR_SINGULAR:
        axes = ", ".join(map(str, cancelling_axes(plan.arm, demand.q_there)))
        lines[1] += f": near one, where axes {axes} cancel each other; watch the first run"
    if demand.removals and plan.has_link:
        lines.append(
            f"the link comes off {demand.removals} times, where the arm cannot follow the sphere past a singularity"
        )
    lines += [
        f"{names[axis]} turns from {low[axis]:.0f}° to {high[axis]:.0f}°, {travel[axis] / 360:.1f} turns in all: "
        "lead cables and hoses so that they allow it"
        for axis in np.flatnonzero(high - low > _FULL_TURN_DEG)
    ]
    return lines
