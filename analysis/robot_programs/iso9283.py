"""The plans of ISO 9283 in front of a tracker: the stops of the cube, and its paths at a share of their speed."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise

import numpy as np

from analysis.geometry.iso_cube import ORDER, Cube, cube_of, cycle_stops, iso9283_of
from analysis.geometry.iso_paths import STAND_S, CommandPath, Polygon, Ring, in_order, joints_along
from analysis.geometry.programs import fastest_joints
from analysis.kinematics.arm import Arm, arm_of
from analysis.robot_programs.plan import Arc, Comment, Dwell, Hold, JointMove, Line, Move, Plan, Step
from analysis.robot_programs.poses import poses_plan, targets_at, tracker_plan
from rigs.errors import PathError, RigPlace
from rigs.rig import Rig

PERCENTS = (100, 50, 10)
"""Shares of the path speed, each a program and a run of its own: ISO 9283, 6.7."""
_STEP_MM = 4.0
_TO_START_RAD_S = float(np.radians(10.0))


def cube_plan(rig: Rig, dwell_s: float) -> Plan:
    """The plan of the poses: from P1 through all cycles, with a stand at each. Raises FileError without a cube."""
    test = iso9283_of(rig)
    names = [f"cycle {cycle}, P{number}" for cycle in range(1, test.cycles + 1) for number in ORDER]
    speed = float(np.radians(test.joint_speed_deg_s))
    stops, start = cycle_stops(rig), cube_of(rig).q[0]
    return poses_plan(rig, stops, dwell_s, start=start, names=names, speed_rad_s=speed, name="cube")


def path_plan(rig: Rig, percent: int) -> Plan:
    """The plan of the paths at so many percent of their speed, each as often as the rig file says, with a stand before
    and after. Raises FileError without a cube, or where a joint is too slow."""
    test, cube, arm = iso9283_of(rig), cube_of(rig), arm_of(rig.robot)
    speed, where = test.path_speed_mm_s * percent / 100, RigPlace.of(rig.name, "tests.iso9283")
    paths = list(in_order(cube, test.path_cycles))
    begin = targets_at(arm, joints_along(arm, cube, paths[0], np.zeros(1), where))[0]
    steps: list[Step] = [JointMove(begin, _TO_START_RAD_S), Hold("start the recording of the tracker, continue")]
    steps.append(Dwell(STAND_S))
    drive: dict[str, list[Move]] = {}
    count = Counter[str]()
    for path in paths:
        if path.name == "way" or path.name not in drive:
            drive[path.name] = _moves(arm, cube, path, speed, where)
        count[path.name] += 1
        if path.name != "way":
            steps.append(Comment(f"{path.name.replace('_', ' ')} {count[path.name]}"))
        steps += [*drive[path.name], Dwell(STAND_S)]
    return tracker_plan(rig, f"path {percent} {rig.name}", steps)


def _moves(arm: Arm, cube: Cube, path: CommandPath, speed: float, where: str) -> list[Move]:
    """The lines or the two arcs of a path, which the tool drives without a stop between them."""
    ends = path.along if isinstance(path, Polygon) else np.array([0.0, 0.5, 1.0]) * path.length_mm
    moves: list[Move] = []
    for number, (begin, end) in enumerate(pairwise(ends.tolist()), start=1):
        s = np.linspace(begin, end, 3 + 2 * int((end - begin) / _STEP_MM / 2))
        q = joints_along(arm, cube, path, s, where)
        for axis in np.flatnonzero(fastest_joints(s / speed, q) > arm.speed):
            what = (
                f"axis {axis + 1} would have to move faster than {np.degrees(arm.speed[axis]):.0f}°/s, which it cannot"
            )
            raise PathError(where, what, "lower path_speed_mm_s", "speed")
        stops = number == len(ends) - 1
        middle, last = targets_at(arm, q[[len(q) // 2, -1]])
        moves.append(
            Arc(middle, last, speed, stops=stops, q=q) if isinstance(path, Ring) else Line(last, speed, stops, q=q)
        )
    return moves
