"""Programs with corrected targets, for a controller that cannot represent the effects of its arm.

`rig correct --path` corrects the targets of a test as a table, in the order in which the programs first reach them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from analysis.apps.makers.motion_plan import (
    Arc,
    Comment,
    JointMove,
    MotionPlan,
    Move,
    PlannedTarget,
    Step,
    StraightMove,
    ToolRotation,
    end_of,
    in_base,
)
from analysis.apps.makers.tool_paths import ToolPath, circular_path, rotation_path, rotation_vector, straight_path
from analysis.correction.support import known_plays
from analysis.robot.kinematics.arm import Array, reported_angles
from analysis.robot.predict import Motion, Path, driven, model_of
from rigs.errors import FileError
from rigs.rig import Rig

_FURTHEST_MM, _FURTHEST_DEG = 20.0, 5.0
"""Distance from the nominal target above which the test or the arm differs: a zero wrong by 1° moves a tool at 1 m by
17 mm, and neighbours on a circle of 50 mm are 38 mm apart."""
_OTHER_POSTURE_DEG = 45.0
"""Rotation of a joint that indicates a different posture. Chosen: near a singularity the wrist turns by several degrees
for a small correction."""
_AFTER_TURN_MM_S = 10.0
_SAME_PLACE_MM = 1e-3
"""Distance from the end of a turn to its target without a line between: below the resolution of a gauge."""
_REMEDY = "give the table of rig program --targets for this rig file and test, corrected by rig correct --path"


def targets_of(plan: MotionPlan) -> list[PlannedTarget]:
    """Targets of a plan without repetitions, in the order in which the program first reaches them."""
    return list({id(target): target for target in _reached(plan)}.values())


def _reached(plan: MotionPlan) -> list[PlannedTarget]:
    return [
        target
        for step in plan.steps
        if isinstance(step, Move)
        for target in ((step.via, step.end) if isinstance(step, Arc) else (step.target,))
    ]


def table_of(plans: Sequence[MotionPlan]) -> str:
    """Targets of the programs of a test as a CSV table for `rig correct --path`."""
    head = "program," + ",".join(f"q{axis}_deg" for axis in range(1, 7))
    rows = [
        f"{plan.name}," + ",".join(f"{angle:.7f}" for angle in np.degrees(target.q) + 0.0)
        for plan in plans
        for target in targets_of(plan)
    ]
    return "\n".join([head, *rows, ""])


def compensated(
    plans: Sequence[MotionPlan], q: Array, poses: Array, lines: Sequence[int], where: str
) -> list[MotionPlan]:
    """Replace the targets of plans by those at the joint angles q (n, 6) rad.

    poses (n, 4, 4): tool poses of the controller's model at these angles, with positions in mm in the world frame.
    lines: line number of each target in the table `where`. Raises FileError if the table does not match the plans, and
    for joint angles beyond the limits.
    """
    counts = [len(targets_of(plan)) for plan in plans]
    if len(q) != sum(counts):
        problem = f"has {len(q)} rows, but this test has {sum(counts)} targets"
        raise FileError(where, problem, _REMEDY, code="table.invalid")
    made, begin = [], 0
    for plan, count in zip(plans, counts, strict=True):
        rows = slice(begin, begin + count)
        targets = [PlannedTarget(T, at) for T, at in zip(in_base(plan.arm, poses[rows]), q[rows], strict=True)]
        made.append(_with_targets(plan, targets, lines[rows], where))
        begin += count
    return made


def _with_targets(plan: MotionPlan, targets: Sequence[PlannedTarget], lines: Sequence[int], where: str) -> MotionPlan:
    old = targets_of(plan)
    each = zip(lines, old, targets, strict=True)
    farthest = max(_correction_mm(plan, nominal, target, f"{where}, line {line}") for line, nominal, target in each)
    new = {id(old_target): new_target for old_target, new_target in zip(old, targets, strict=True)}
    steps: list[Step] = [Comment(f"the targets are corrected by up to {farthest:.2f} mm")]
    moved_by_ends: dict[tuple[int, int], tuple[Step, ...]] = {}  # Laps and visits repeat identical moves.
    at = old[0]
    for step in plan.steps:
        if not isinstance(step, Move):
            steps.append(step)
            continue
        key = id(at), id(step)
        if key not in moved_by_ends:
            moved_by_ends[key] = tuple(_moved(plan, step, new[id(at)], new))
        steps += moved_by_ends[key]
        at = end_of(step)
    return replace(plan, steps=tuple(steps))


def _moved(plan: MotionPlan, step: Move, begin: PlannedTarget, new: dict[int, PlannedTarget]) -> Iterator[Step]:
    match step:
        case Arc(via, end):
            via, end = new[id(via)], new[id(end)]
            q = _followed(plan, circular_path(begin.T, via.T[:3, 3], end.T, step.speed_mm_s), begin)
            # An arc that turns with the path would end along its tangent, which corrected positions rotate.
            yield replace(step, via=via, end=end, with_path=False, q=q)
        case ToolRotation(target):
            # The two orientations have different corrections: a turn about a fixed point misses the second position.
            end = new[id(target)]
            T = end.T.copy()
            T[:3, 3] = begin.T[:3, 3]
            q = _followed(plan, rotation_path(begin.T, T, step.speed_rad_s), begin)
            turned_target = PlannedTarget(T, q[-1])
            yield replace(step, target=turned_target, angle=float(np.linalg.norm(rotation_vector(begin.T, T))), q=q)
            if np.linalg.norm(end.T[:3, 3] - begin.T[:3, 3]) > _SAME_PLACE_MM:
                yield _line(plan, turned_target, end, _AFTER_TURN_MM_S)
        case StraightMove(target, speed_mm_s):
            end = new[id(target)]
            # The line to the start serves a controller with a different tool position at the joint angles.
            on_the_spot = end is begin
            yield replace(step, target=end) if on_the_spot else _line(plan, begin, end, speed_mm_s)
        case JointMove(target):
            yield replace(step, target=new[id(target)])


def _line(plan: MotionPlan, begin: PlannedTarget, end: PlannedTarget, speed_mm_s: float) -> StraightMove:
    return StraightMove(end, speed_mm_s, q=_followed(plan, straight_path(begin.T, end.T, speed_mm_s), begin))


def _followed(plan: MotionPlan, way: ToolPath, begin: PlannedTarget) -> Array:
    return way.followed(plan.arm, begin.q, f"the corrected program {plan.name}")


def _correction_mm(plan: MotionPlan, nominal: PlannedTarget, target: PlannedTarget, where: str) -> float:
    """Distance from the nominal target. Raises FileError if it is too large for a correction, or beyond a limit."""
    mm = float(np.linalg.norm(target.T[:3, 3] - nominal.T[:3, 3]))
    deg = float(np.degrees(np.linalg.norm(rotation_vector(nominal.T, target.T))))
    joint_deg = float(np.degrees(np.abs(target.q - nominal.q).max()))
    if mm > _FURTHEST_MM or deg > _FURTHEST_DEG or joint_deg > _OTHER_POSTURE_DEG:
        differs = (
            f"{mm:.0f} mm and {deg:.0f}° from the target of this test, with a joint difference of {joint_deg:.0f}°"
        )
        raise FileError(where, f"is {differs}: too large for a correction", _REMEDY, code="table.invalid")
    for axis in np.flatnonzero((target.q < plan.arm.limits[:, 0]) | (target.q > plan.arm.limits[:, 1])):
        at_deg, (low, high) = np.degrees(target.q[axis]), np.degrees(plan.arm.limits[axis])
        problem = f"axis {axis + 1} would be at {at_deg:.3f}°, beyond the limits {low:g}° and {high:g}°"
        raise FileError(where, problem, "move the test away from the limit", code="path.impossible")
    return mm


_BETWEEN = 16
"""Intermediate positions for detecting joint reversals between two targets."""


def ahead_of_plays(rig: Rig, plan: MotionPlan) -> Array:
    """Lead (n, 6) rad of the joints with which the links reach `targets_of` a plan despite the backlash of the rig."""
    targets = targets_of(plan)
    model = model_of(rig, known_plays(rig))
    if not model.effects:
        return np.zeros((len(targets), 6))
    places = {id(target): number for number, target in enumerate(targets)}
    visits = 2 * [places[id(target)] for target in _reached(plan)]
    share = np.arange(_BETWEEN)[:, None] / _BETWEEN
    stops = [targets[number].q for number in visits]
    q = np.concatenate([*(begin + share * (end - begin) for begin, end in pairwise(stops)), stops[-1][None]])
    rows = _BETWEEN * np.arange(len(stops))
    motion = Motion(np.arange(len(q), dtype=float), q)
    scene = driven(model, Path(motion, rows))
    lag = reported_angles(model.arm, scene.link_q - scene.q)[rows]
    last = {number: row for row, number in enumerate(visits)}
    return -np.array([lag[last[number]] for number in range(len(targets))])
