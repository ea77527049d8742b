"""What a plan asks of the arm, before anything is written: limits, singularities, turns of the wrist, room."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from analysis.kinematics.arm import Array, forward
from analysis.kinematics.newton import cancelling_axes, conditioning
from analysis.robot_programs.plan import Dwell, JointMove, Move, Plan, Target, Turn, end_of, in_base, start_of

_STEP_RAD = np.radians(2.0)
"""The fastest joint turns by so much between samples of a joint move."""
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
    """What a plan asks of the arm."""
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
    """Joint angles (n, 6) rad along a move, without its beginning."""
    if not isinstance(move, JointMove):
        return move.q[1:]
    count = 1 + int(np.abs(move.target.q - begin.q).max() / _STEP_RAD)
    joints: Array = begin.q + np.linspace(0, 1, count + 1)[1:, None] * (move.target.q - begin.q)
    return joints


def seconds_of(plan: Plan) -> float:
    """How long a program takes from where it stands at its start, without waiting for a person, s."""
    at, seconds = start_of(plan), 0.0
    for step in plan.steps:
        if isinstance(step, Dwell):
            seconds += step.seconds
        elif isinstance(step, Move):
            seconds += _seconds_of_move(plan, at, step)
            at = end_of(step)
    return seconds


def _seconds_of_move(plan: Plan, begin: Target, move: Move) -> float:
    q = np.concatenate([begin.q[None], angles_along(begin, move)])
    if isinstance(move, JointMove):
        return float(np.abs(move.target.q - begin.q).max() / move.speed_rad_s)
    if isinstance(move, Turn):
        return move.angle / move.speed_rad_s
    places = in_base(plan.arm, forward(plan.arm, q))[:, :3, 3]
    return float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum()) / move.speed_mm_s


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
