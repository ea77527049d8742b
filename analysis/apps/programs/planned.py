"""Motion plans of the tests of a rig, with the motion of the simulator (analysis/robot/geometry/driven_programs.py).

Circles have a program per direction, because each direction is a separate run.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from analysis.apps.makers.motion_plan import (
    Arc,
    Comment,
    Dwell,
    Hold,
    JointMove,
    MotionPlan,
    Move,
    PlannedTarget,
    Signal,
    SignalPlace,
    Step,
    StraightMove,
    in_base,
)
from analysis.apps.makers.tool_paths import moves_over_sphere, straight_path
from analysis.robot.geometry.circle import frame_of
from analysis.robot.geometry.driven_programs import (
    PAUSE_S,
    circle_of,
    circle_program,
    fastest_joints,
    hemisphere_of,
    lap,
    radial_stops,
    repeatability_of,
    repeatability_stops,
    way_back,
)
from analysis.robot.geometry.iso_cube import (
    ORDER,
    STANDSTILL_S,
    CommandPath,
    Cube,
    Polygon,
    Ring,
    cube_of,
    cycle_stops,
    in_order,
    iso9283_of,
    joints_along,
)
from analysis.robot.kinematics.arm import Arm, Array, arm_of, forward
from rigs.errors import FileError, PathError, RigPlace, UseError
from rigs.rig import Rig
from rigs.schema.feedback import signal_of_outputs
from rigs.schema.part import Vector
from rigs.schema.vocabulary import CIRCLES, Direction, DrivenTest

_SPEED_RAD_S = float(np.radians(20.0))
"""Speed of the fastest joint between poses: slow enough to stop by hand."""


def poses_plan(
    rig: Rig,
    q: Array,
    dwell_s: float,
    *,
    start: Array | None = None,
    names: Sequence[str] | None = None,
    speed_rad_s: float = _SPEED_RAD_S,
    name: str = "pose",
) -> MotionPlan:
    """Plan that stops at each posture q (n, 6) rad for dwell_s seconds.

    start (6,): joint angles at the start, by default the first posture. names (n,): comment for each posture.
    """
    arm = arm_of(rig.robot)
    first, *targets = targets_at(arm, np.concatenate([q[:1] if start is None else start[None], q]))
    names = names or [f"pose {number}" for number in range(1, len(q) + 1)]
    steps: list[Step] = [JointMove(first, _SPEED_RAD_S / 2), Hold("start the tracker, continue")]
    for label, target in zip(names, targets, strict=True):
        steps += [Comment(label), JointMove(target, speed_rad_s), Dwell(dwell_s)]
    return tracker_plan(rig, f"{name} {rig.name}", steps)


def targets_at(arm: Arm, q: Array) -> list[PlannedTarget]:
    return [PlannedTarget(T, angles) for T, angles in zip(in_base(arm, forward(arm, q)), q, strict=True)]


def tracker_plan(rig: Rig, name: str, steps: Sequence[Step]) -> MotionPlan:
    """Plan for a tracker: no ball link, and no signal for automatic runs."""
    return MotionPlan(
        name=name,
        arm=arm_of(rig.robot),
        payload_kg=rig.robot.payload_kg,
        ball_mm=np.zeros(3),
        signal_place=SignalPlace(),
        feedback=rig.feedback,
        length_unit=rig.length_unit,
        steps=tuple(steps),
        has_link=False,
    )


LONGEST_ARC_DEG = 90.0
"""Controllers rotate the tool along an arc in different ways, but all agree below half a turn about the x axis of the
tool, which changes only one of the angles (W, C, Rx). Shorter arcs would add transitions that disturb the motion."""
_FINE_RAD = np.radians(1.0)
_Piece = tuple[PlannedTarget, PlannedTarget, PlannedTarget, Array]
"""Start, middle and end of an arc, and the joint angles (n, 6) rad along it."""
_APPROACH_RAD_S = np.radians(10.0)
"""Speed of the fastest joint to the start from any position: slow enough to stop by hand."""
_APPROACH_MM_S = 10.0
_SAME_DECIMALS = 6
"""Decimals of joint angles in rad of equal targets."""
_STANDSTILL_S = 3.0
"""Standstill before the motion. Automatic runs detect a program by a standstill of `still_s`, by default 2 s."""


def plans_of(
    rig: Rig,
    test: DrivenTest,
    dwell_s: float,
    outputs: tuple[int, ...] = (),
    arc_deg: float = LONGEST_ARC_DEG,
) -> list[MotionPlan]:
    """Plan the programs of a test.

    dwell_s: standstill at each target. outputs: for the signal of automatic runs, unless the rig file names them.
    arc_deg: longest arc of a circle. Raises FileError if the robot cannot execute a plan, and UseError for outputs that
    no program would switch.
    """
    directions: tuple[Direction, ...] = ("acw", "cw") if test in CIRCLES else ()
    if outputs and not any(_signal_of(rig, test, direction)[0] for direction in directions or (None,)):
        problem = f"the rig file has no rule for a signal of the {test} test"
        raise UseError("--outputs", problem, "add a rule to automatic.rules, or omit --outputs", code="usage")
    if directions:
        return [_circle(rig, test, direction, outputs, arc_deg) for direction in directions]
    return [_radial(rig, dwell_s, outputs) if test == "radial" else _repeatability(rig, dwell_s, outputs)]


def _circle(rig: Rig, test: DrivenTest, direction: Direction, outputs: tuple[int, ...], arc_deg: float) -> MotionPlan:
    circle, arm = circle_of(rig), arm_of(rig.robot)
    t_s, phi = lap(circle, direction)
    q = circle_program(rig, direction).q[: len(t_s)]
    # Arcs of equal length, at most arc_deg.
    driven = np.abs(phi - phi[0])
    count = int(np.ceil(driven[-1] / np.radians(arc_deg) - 1e-9))
    half = int(np.ceil(driven[-1] / (2 * count) / _FINE_RAD))
    share = np.linspace(0, 1, 2 * half * count + 1)
    poses = in_base(arm, frame_of(circle).poses(phi[0] + share * (phi[-1] - phi[0])))
    at = np.stack([np.interp(share * driven[-1], driven, angles) for angles in q.T], axis=1)
    targets = [PlannedTarget(T, angles) for T, angles in zip(poses[::half], at[::half], strict=True)]
    begins = range(0, 2 * count, 2)
    pieces = [(targets[k], targets[k + 1], targets[k + 2], at[k * half : (k + 2) * half + 1]) for k in begins]
    lap_arcs = _arcs(pieces, circle.speed_mm_s)
    reverse = [(end, via, begin, along[::-1]) for begin, via, end, along in reversed(pieces)]
    back = _arcs(reverse, way_back(arm, fastest_joints(t_s, q)) * circle.speed_mm_s)
    laps: list[Step] = [Comment(f"lap 1 of {circle.laps}"), *lap_arcs]
    for number in range(2, circle.laps + 1):
        laps += [Comment("the way back"), Dwell(PAUSE_S), *back, Dwell(PAUSE_S)]
        laps += [Comment(f"lap {number} of {circle.laps}"), *lap_arcs]
    away_rad = q[0 if direction == "acw" else -1] - np.radians(circle.posture_deg)
    turns = np.rint(away_rad / (2 * np.pi)).astype(int)
    return replace(_plan(rig, test, direction, outputs, pieces[0][0], laps), full_turns=tuple(turns.tolist()))


def _arcs(pieces: list[_Piece], speed_mm_s: float) -> list[Step]:
    last = len(pieces) - 1
    return [
        Arc(via, end, speed_mm_s, stops=number == last, with_path=True, q=q)
        for number, (_, via, end, q) in enumerate(pieces)
    ]


def _radial(rig: Rig, dwell_s: float, outputs: tuple[int, ...]) -> MotionPlan:
    arm, centre, radius = _sphere(rig)
    targets = targets_at(arm, radial_stops(rig))
    steps: list[Step] = [Dwell(dwell_s)]
    at, ways = targets[0], dict[bytes, tuple[list[Step], PlannedTarget]]()
    for target in targets[1:]:
        # Every visit uses the same moves.
        key = np.concatenate([at.q, target.q]).round(_SAME_DECIMALS).tobytes()
        way, at = ways[key] = ways.get(key) or moves_over_sphere(arm, at, target, centre, radius)
        steps += [*way, Dwell(dwell_s)]
    return _plan(rig, "radial", None, outputs, targets[0], steps)


def _repeatability(rig: Rig, dwell_s: float, outputs: tuple[int, ...]) -> MotionPlan:
    plan = repeatability_of(rig)
    stops = repeatability_stops(rig).reshape(len(plan.targets), -1, 6)
    arm, centre, radius = _sphere(rig)
    first = targets_at(arm, stops[0, :1])[0]
    at, steps = first, list[Step]()
    for number, angles in zip(plan.targets, stops, strict=True):
        target, *around = targets_at(arm, angles)
        way, at = moves_over_sphere(arm, at, target, centre, radius)
        steps += [Comment(f"target {number}"), *way, Dwell(dwell_s)]
        for aside, again in zip(around[::2], around[1::2], strict=True):
            away, at = _line(rig, at, aside)
            back, at = _line(rig, at, again)
            steps += [away, back, Dwell(dwell_s)]
    return _plan(rig, "repeatability", None, outputs, first, steps)


def _line(rig: Rig, begin: PlannedTarget, end: PlannedTarget) -> tuple[StraightMove, PlannedTarget]:
    way = straight_path(begin.T, end.T, _APPROACH_MM_S)
    q = way.followed(arm_of(rig.robot), begin.q, RigPlace.of(rig.name, "tests.repeatability"))
    arrived = replace(end, q=q[-1])
    return StraightMove(arrived, _APPROACH_MM_S, q=q), arrived


def _sphere(rig: Rig) -> tuple[Arm, Array, float]:
    """The arm, and centre (3,) mm in the base frame and radius in mm of the hemisphere."""
    arm, hemisphere = arm_of(rig.robot), hemisphere_of(rig)
    return arm, _ball(arm, hemisphere.centre_mm), hemisphere.radius_mm


def _ball(arm: Arm, centre_mm: Vector) -> Array:
    place: Array = (np.linalg.inv(arm.T_world_base) @ [*centre_mm, 1.0])[:3]
    return place


def _plan(
    rig: Rig,
    test: DrivenTest,
    direction: Direction | None,
    outputs: tuple[int, ...],
    start: PlannedTarget,
    motion: list[Step],
) -> MotionPlan:
    arm = arm_of(rig.robot)
    ball = circle_of(rig).centre_mm if test in CIRCLES else hemisphere_of(rig).centre_mm
    number, automatic = _signal_of(rig, test, direction)
    hold = [] if automatic else [Hold("mount the ball link, start the recording, continue")]
    begin, end = ([Signal(number)], [Signal(0)]) if number else ([], [])
    # If constants of the controller were corrected, the tool is elsewhere at the same joint angles, and the line moves
    # it to the start; otherwise the line has zero length.
    approach: list[Step] = [
        JointMove(start, _APPROACH_RAD_S),
        StraightMove(start, _APPROACH_MM_S, q=np.stack([start.q] * 2)),
    ]
    steps = [*approach, *hold, Dwell(_STANDSTILL_S), *begin, *motion, *end, Dwell(_STANDSTILL_S)]
    return MotionPlan(
        name=" ".join(filter(None, [test, direction, rig.name])),
        arm=arm,
        payload_kg=rig.robot.payload_kg,
        ball_mm=_ball(arm, ball),
        signal_place=_signal_place(rig, number, outputs),
        feedback=rig.feedback,
        length_unit=rig.length_unit,
        steps=tuple(steps),
    )


def _signal_of(rig: Rig, test: DrivenTest, direction: Direction | None) -> tuple[int, bool]:
    """Number announcing a program, 0 for none, and whether the runs start automatically."""
    for rule in rig.automatic.rules if rig.automatic else ():
        if (rule.test, rule.direction) == (test, direction):
            return rule.when.signal or 0, True
    return 0, False


def _signal_place(rig: Rig, number: int, outputs: tuple[int, ...]) -> SignalPlace:
    """Outputs or register for the number of a program. Raises FileError if none is configured."""
    if not number:
        return SignalPlace()
    if place := signal_of_outputs(rig.feedback):
        outputs = place.outputs
        if place.int_register is not None:
            return SignalPlace(int_register=place.int_register)
    if number < 0 or number >= 1 << len(outputs):
        problem = f"signal {number} does not fit into {len(outputs)} outputs"
        remedy = "give --outputs with the digital outputs read by the feedback, least significant first"
        raise FileError(RigPlace.of(rig.name, "automatic"), problem, remedy, code="output.invalid")
    return SignalPlace(outputs=outputs)


PERCENTS = (100, 50, 10)
"""Percentages of the path speed, each a separate program and run: ISO 9283, 6.7."""
_STEP_MM = 4.0
_TO_START_RAD_S = float(np.radians(10.0))


def cube_plan(rig: Rig, dwell_s: float) -> MotionPlan:
    """Plan of the stops of all cycles. Raises FileError if there is no cube."""
    test = iso9283_of(rig)
    names = [f"cycle {cycle}, P{number}" for cycle in range(1, test.cycles + 1) for number in ORDER]
    speed = float(np.radians(test.joint_speed_deg_s))
    stops, start = cycle_stops(rig), cube_of(rig).q[0]
    return poses_plan(rig, stops, dwell_s, start=start, names=names, speed_rad_s=speed, name="cube")


def path_plan(rig: Rig, percent: int) -> MotionPlan:
    """Plan of the paths at a percentage of the path speed, with a standstill before and after each.

    Raises FileError if there is no cube, or a joint is too slow.
    """
    test, cube, arm = iso9283_of(rig), cube_of(rig), arm_of(rig.robot)
    speed, where = test.path_speed_mm_s * percent / 100, RigPlace.of(rig.name, "tests.iso9283")
    paths = list(in_order(cube, test.path_cycles))
    begin = targets_at(arm, joints_along(arm, cube, paths[0], np.zeros(1), where))[0]
    steps: list[Step] = [JointMove(begin, _TO_START_RAD_S), Hold("start the recording of the tracker, continue")]
    steps.append(Dwell(STANDSTILL_S))
    drive: dict[str, list[Move]] = {}
    count = Counter[str]()
    for path in paths:
        if path.name == "way" or path.name not in drive:
            drive[path.name] = _moves(arm, cube, path, speed, where)
        count[path.name] += 1
        if path.name != "way":
            steps.append(Comment(f"{path.name.replace('_', ' ')} {count[path.name]}"))
        steps += [*drive[path.name], Dwell(STANDSTILL_S)]
    return tracker_plan(rig, f"path {percent} {rig.name}", steps)


def _moves(arm: Arm, cube: Cube, path: CommandPath, speed: float, where: str) -> list[Move]:
    ends = path.arc_length_mm if isinstance(path, Polygon) else np.array([0.0, 0.5, 1.0]) * path.length_mm
    moves: list[Move] = []
    for number, (begin, end) in enumerate(pairwise(ends.tolist()), start=1):
        s = np.linspace(begin, end, 3 + 2 * int((end - begin) / _STEP_MM / 2))
        q = joints_along(arm, cube, path, s, where)
        for axis in np.flatnonzero(fastest_joints(s / speed, q) > arm.speed):
            problem = f"axis {axis + 1} would have to exceed {np.degrees(arm.speed[axis]):.0f}°/s, the maximum speed"
            raise PathError(where, problem, "lower path_speed_mm_s", "speed")
        stops = number == len(ends) - 1
        middle, last = targets_at(arm, q[[len(q) // 2, -1]])
        moves.append(
            Arc(middle, last, speed, stops=stops, q=q)
            if isinstance(path, Ring)
            else StraightMove(last, speed, stops, q=q)
        )
    return moves
