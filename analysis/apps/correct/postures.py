"""The joint angles that a controller computes at the targets of a program.

A target with an uncertain posture is not corrected. The posture is determined, in this order, by joint angles in the
program near the pose, by posture flags that only a single solution matches, by the moves from all previous targets,
along which the arm keeps the posture, or by the user, who states one posture for all targets that are left.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypeGuard

import numpy as np

from analysis.apps.makers.target import AT_BEGIN, Arc, Flags, Target, TargetMove, Way
from analysis.apps.makers.tool_paths import circular_path, rotations, straight_path
from analysis.correction.reasons import Reason
from analysis.correction.table_postures import (
    PoseSolutions,
    closest_solution,
    configuration_of,
    solutions_within_limits,
)
from analysis.robot.geometry.circle import circles_through
from analysis.robot.kinematics.arm import Arm, Array, Mask, forward
from analysis.robot.kinematics.follow import follow
from analysis.robot.kinematics.joint_limits import SAME_RAD
from analysis.robot.kinematics.newton import conditioning
from rigs.errors import FileError

_ROUNDING_RAD = np.radians(0.02)
"""Tolerance for wrist angles of a pose with the decimals of a program, 0.001 mm and 0.001°. Near the end of a
quadrant or a turn either flag agrees. Chosen."""


def agreeing(arm: Arm, q: Array, flags: Flags, slack_rad: float = _ROUNDING_RAD) -> Mask:
    """Mask (n,) of the solutions q (n, 6) rad that agree with flags, up to slack_rad beyond a sign or quadrant."""
    return flags.agreeing(arm, q, flags.values, slack_rad) if len(q) else np.zeros(0, dtype=bool)


_NEAR_RAD = np.radians(60.0)
"""Largest joint rotation to the nearest solution that still identifies the solution. Chosen: in other postures a
wrist joint differs by 180° less twice axis 5."""
_CLEARLY = 2.0
"""Ratio of the distances to the second nearest and the nearest solution below which it is ambiguous. Chosen."""
_ANY_MM_S = 100.0
"""Speed for computing a path. The positions do not depend on the speed."""
_PAST_SINGULARITY = 0.01
"""Conditioning below which the controller decides to which side the wrist turns on a line: an angle of axis 5 below
2.3°, or 4 mm at the wrist, which a robot passes between two set points."""
_HALF_TURN_RAD = np.radians(178.0)
"""Rotation of the tool along a line above which a correction may reverse its direction. Chosen: half a turn less twice
the largest correction of an orientation."""
_SAME_ORIENTATION_RAD = np.radians(0.1)
"""Tolerance for equal orientations. Chosen: it changes a correction of 1 mm by 2 µm."""
_FLAT = 1e-4
"""Sine of an angle below which three points of an arc are collinear. Chosen: a radius of several hundred metres."""
_LONGEST_MM = 1e4
"""Maximum length of a line of an arm: 10 m."""
_OPEN: tuple[Reason, ...] = ("no_posture", "ambiguous", "past_singularity", "arc_turns")
"""Reasons of targets whose posture the program does not determine, so that a statement can."""


@dataclass(frozen=True)
class ProgramPostures:
    """What the user states about the postures in a program."""

    start: tuple[float, ...] | None = None
    """Joint angles (6,) rad of the arm when the program starts."""
    near: tuple[float, ...] | None = None
    """Joint angles (6,) rad in whose configuration the arm reaches each target whose posture the program leaves
    open."""


UNSTATED = ProgramPostures()


def solved(
    arm: Arm,
    targets: Sequence[Target],
    poses: Array,
    joint_angles: Array,
    steps: Sequence[TargetMove],
    stated: ProgramPostures,
    tips: Array | None = None,
) -> tuple[Array, dict[int, Reason], frozenset[int]]:
    """Solve the joint angles (n, 6) rad of targets, with the reasons for missing ones, and the targets at which only
    the user states the posture, which moves carry on to others.

    poses (n, 4, 4): poses of the arm's tool in the world, NaN for joint targets. joint_angles (n, 6): rad, NaN for
    poses. tips (n, 3): points that the program moves, in mm in the arm's tool.
    """
    start = stated.start
    q = np.vstack([joint_angles, np.full(6, np.nan) if start is None else start])  # The last row has index AT_BEGIN.
    poses = poses.copy()
    asked = [k for k, target in enumerate(targets) if not target.joints and np.isfinite(poses[k]).all()]
    lines = {step.target for step in steps if step.way == "line" and targets[step.target].joints}
    by_line = [k for k in sorted(lines) if np.isfinite(q[k]).all()]  # A line to joint angles ends at their pose.
    poses[by_line] = forward(arm, q[by_line])
    branches: dict[int, PoseSolutions | Reason] = dict(
        zip([*asked, *by_line], solutions_within_limits(arm, poses[[*asked, *by_line]]), strict=True)
    )
    postures = _Postures(arm, targets, poses, branches, q, np.zeros((len(targets), 3)) if tips is None else tips)
    for k in asked:
        solutions, target = branches[k], targets[k]
        if isinstance(solutions, str):
            postures.take(k, solutions)
        elif target.near is not None:
            postures.take(k, _nearest(solutions.q, np.array(target.near)))
        elif target.flags:
            chosen = solutions.q[agreeing(arm, solutions.q, target.flags)]
            postures.take(k, chosen[0] if len(chosen) == 1 else "ambiguous" if len(chosen) else "other_flags")
    postures.derive(steps)
    for k in asked:
        if k not in postures.reasons and not postures.is_solved(k):
            postures.take(k, "no_posture")
    by_user = frozenset[int]() if stated.near is None else postures.state(steps, np.array(stated.near))
    return q[:AT_BEGIN], postures.reasons, by_user


def _nearest(solutions: Array, near: Array) -> Array | Reason:
    """Solution (6,) rad nearest to angles (6,) rad, or the reason if it is ambiguous."""
    away = np.abs(solutions - near).max(axis=1)
    first, *second = np.sort(away)[:2]
    if first > _NEAR_RAD or (second and second[0] < _CLEARLY * first):
        return "ambiguous"
    nearest: Array = solutions[away.argmin()]
    return nearest


def _closest_turn(turns: Array, stands: Array) -> Array:
    """Of solutions (n, 6) rad that differ by full turns, the one (6,) rad closest to angles (6,) rad."""
    closest: Array = turns[np.abs(turns - stands).max(axis=1).argmin()]
    return closest


def _closest(solutions: Array, stands: Array) -> Array | Reason:
    closest = closest_solution(solutions, stands)
    return "ambiguous" if closest is None else closest


@dataclass
class _Postures:
    """The postures at the targets of a program during the search, and the reasons for missing ones."""

    arm: Arm
    targets: Sequence[Target]
    poses: Array
    branches: dict[int, PoseSolutions | Reason]
    q: Array
    tips: Array
    reasons: dict[int, Reason] = field(default_factory=dict)
    arrivals: dict[tuple[bytes, bytes, Way], Array | Reason] = field(default_factory=dict)

    def take(self, k: int, solution: Array | Reason) -> None:
        if isinstance(solution, str):
            self.reasons[k] = solution
        else:
            self.q[k] = solution

    def is_solved(self, k: int) -> bool:
        return bool(np.isfinite(self.q[k]).all())

    def is_known(self, k: int | None) -> TypeGuard[int]:
        return k is not None and k not in self.reasons and self.is_solved(k)

    def reached(self, source: int, k: int, way: Way) -> Array | Reason:
        """Joint angles (6,) rad at target k after a move from the target `source`, or the reason if unknown."""
        key = (self.q[source].tobytes(), self.poses[k].tobytes(), way)  # Programs repeat their positions.
        if key not in self.arrivals:
            solutions = self.branches[k]
            assert not isinstance(solutions, str)  # noqa: S101 - those have a reason already
            self.arrivals[key] = _reached(self.arm, self.q[source], self.poses[k], solutions.q, way)
        return self.arrivals[key]

    def derive(self, steps: Sequence[TargetMove]) -> None:
        """Derive postures that are not stated from the previous targets, and reject targets with different postures on
        different paths."""
        free = {k for k, of in enumerate(self.targets) if not of.joints and of.near is None and of.flags is None}
        waiting = [step for step in steps if step.target in free and step.target in self.branches]
        solved_some = True
        while solved_some:
            solved_some = False
            for step in waiting:
                k, sources = step.target, list(filter(self.is_known, step.comes_from))
                if sources and not self.is_solved(k) and k not in self.reasons:
                    self.take(k, self.reached(min(sources), k, step.way))
                    solved_some = True
        bad: dict[int, Reason] | None = None
        while bad is None or bad:
            bad = {}
            for step in (step for step in steps if step.target not in self.reasons):
                if why := self._not_the_same(step, free) or self._turned(step.arc):
                    bad[step.target] = why
            self.reasons.update(bad)
        # Points that the program reaches only with an offset have the posture of an approach.
        itself = {step.target for step in steps}
        for approach, target in enumerate(self.targets):
            point = target.of
            if point is None or point in itself or point in self.reasons or self.is_solved(point):
                continue
            if self.is_known(approach) and not isinstance(self.branches.get(point, "unreachable"), str):
                arrived = self.reached(approach, point, "line")
                if not isinstance(arrived, str):
                    self.q[point] = arrived

    def _not_the_same(self, step: TargetMove, free: set[int]) -> Reason | None:
        """Reason if a move may reach the target in another posture than the corrected one."""
        k = step.target
        if isinstance(self.branches.get(k, "unreachable"), str) or not self.is_solved(k):  # Joints, or no posture
            return None
        if self.targets[k].joints and step.way != "line":
            return None
        by_way = k in free or not step.by_flags
        for source in step.comes_from:
            if not self.is_known(source):
                if by_way:
                    return "no_posture"
                continue
            if not by_way and step.way != "line":
                continue
            arrived = self.reached(source, k, step.way)
            if isinstance(arrived, str):
                return arrived
            if np.abs(np.sin((arrived - self.q[k]) / 2) if not by_way else arrived - self.q[k]).max() > SAME_RAD:
                return "two_postures"
        return None

    def state(self, steps: Sequence[TargetMove], near: Array) -> frozenset[int]:
        """Reach the targets whose posture the program leaves open in the configuration of angles near (6,) rad.

        Every move that determines a posture must agree. Otherwise the statement is wrong for this program, and none of
        its targets takes a posture from it. Returns the targets at which no move determines the posture.
        """
        configuration = configuration_of(self.arm, near)
        choices = {k: self._in_configuration(k, configuration) for k, why in self.reasons.items() if why in _OPEN}
        wrong = {k for k, of in choices.items() if of is not None and not len(of)}
        waiting = {k: of for k, of in choices.items() if of is not None and len(of)}
        stated, before = frozenset(waiting), (dict(self.reasons), self.q.copy())
        for k in stated:
            del self.reasons[k]
            self.q[k] = np.nan
        moves = [step for step in steps if step.target in stated]
        while waiting:  # A move ends in the turn closest to that of its start.
            count = len(waiting)
            for step in moves:
                if step.target in waiting and (sources := list(filter(self.is_known, step.comes_from))):
                    self.q[step.target] = _closest_turn(waiting.pop(step.target), self.q[min(sources)])
            if len(waiting) == count:
                k = next(iter(waiting))
                self.q[k] = _closest_turn(waiting.pop(k), near)
        by_user = stated - {step.target for step in steps}
        for step in steps:
            if step.target in self.reasons:
                continue
            why = self._contradicts(step, stated)
            if (why == "ambiguous" and step.way != "line") or why in ("no_posture", "past_singularity"):
                by_user |= {step.target}
                why = None
            if why := why or self._turned(step.arc):
                wrong |= {step.target} if why == "other_posture" else set()
                self.reasons[step.target] = why
        if wrong:
            self.reasons = before[0] | dict.fromkeys(wrong, "other_posture")
            self.q[:] = before[1]
            return frozenset()
        return by_user - self.reasons.keys()

    def _in_configuration(self, k: int, configuration: int) -> Array | None:
        """Solutions (n, 6) rad of target k in a configuration, which differ by full turns; None if it selects none."""
        solutions, flags = self.branches.get(k), self.targets[k].flags
        if solutions is None or isinstance(solutions, str) or self.targets[k].joints:
            return None
        allowed = solutions.in_configuration(self.arm, self.poses[k], configuration)
        if len(np.unique(allowed.branch)) > 1:
            return None
        return allowed.q[agreeing(self.arm, allowed.q, flags)] if flags else allowed.q

    def _contradicts(self, step: TargetMove, stated: frozenset[int]) -> Reason | None:
        """Reason if a move ends in another posture than the stated one, or does not determine the posture."""
        k, open_ = step.target, None
        if isinstance(self.branches.get(k, "unreachable"), str) or not self.is_solved(k):
            return None
        for source in step.comes_from:
            if k not in stated and (source not in stated or step.way != "line"):
                continue
            arrived = self.reached(source, k, step.way) if self.is_known(source) else "no_posture"
            if isinstance(arrived, str):
                open_ = arrived
            elif np.abs(np.sin((arrived - self.q[k]) / 2)).max() > SAME_RAD:
                return "other_posture"
        return open_

    def _turned(self, arc: Arc | None) -> Reason | None:
        """Reason if an arc that rotates the tool with the tangent does not produce the written orientations."""
        if arc is None or not arc.tangent:
            return None
        if arc.through is None or arc.end is None or not all(map(self.is_known, (*arc.starts, arc.through, arc.end))):
            return "arc_turns"
        through, end = self.poses[arc.through], self.poses[arc.end]
        if not np.isfinite([through, end]).all():  # Joint targets
            return "arc_turns"
        tip = np.append(self.tips[arc.end], 1.0)
        for begin in forward(self.arm, self.q[[*filter(self.is_known, arc.starts)]]):
            turns = _turns_on_arc(np.array([T @ tip for T in (begin, through, end)])[:, :3])
            if turns is None:
                return "arc_turns"
            for R, T in zip(turns, (through, end), strict=True):
                away = T[:3, :3].T @ R @ begin[:3, :3]
                if np.trace(away) < 1 + 2 * np.cos(_SAME_ORIENTATION_RAD):
                    return "arc_turns"
        return None


def _turns_on_arc(places: Array) -> Array | None:
    """Rotations (2, 3, 3) along an arc through three positions (3, 3) mm, from the first one to each of the others.

    None if the positions are collinear.
    """
    first, second = places[1:] - places[0]
    if np.linalg.norm(np.cross(first, second)) <= _FLAT * np.linalg.norm(first) * np.linalg.norm(second):
        return None
    (centre,), (axis,), _ = circles_through(places[None])
    begin, *spokes = places - centre
    angles = [np.arctan2(axis @ np.cross(begin, spoke), begin @ spoke) % (2 * np.pi) for spoke in spokes]
    return rotations(axis, np.array(angles))


def arc_to_via(arm: Arm, stands: Array, poses: Array, tip: Array) -> Array | None:
    """Angles (6,) rad at the via point of an arc with the orientation interpolated from start to end.

    stands (6,): angles at the start in rad. poses (3, 4, 4): written poses of start, via point and end. tip (3,): point
    in mm that follows the arc, in the frame of the arm's tool. None if the arm cannot follow the arc.
    """
    offset = np.eye(4)
    offset[:3, 3] = tip
    begin, via, end = poses @ offset
    if np.linalg.norm(np.cross(via[:3, 3] - begin[:3, 3], end[:3, 3] - begin[:3, 3])) < _FLAT:
        return None
    way = circular_path(begin, via[:3, 3], end, _ANY_MM_S).poses
    last = int(np.linalg.norm(way[:, :3, 3] - via[:3, 3], axis=1).argmin())
    way[last, :3, 3] = via[:3, 3]
    try:
        angles: Array = follow(arm, way[: last + 1] @ np.linalg.inv(offset), stands, "an arc")[-1]
    except FileError:
        return None
    return angles


def _reached(arm: Arm, stands: Array, pose: Array, solutions: Array, way: Way) -> Array | Reason:
    """Angles (6,) rad at a pose (4, 4) after a move from the angles `stands` (6,) rad."""
    if way != "line":
        return _nearest(solutions, stands) if way == "joint" else _closest(solutions, stands)
    begin = forward(arm, stands[None])[0]
    if np.linalg.norm(pose[:3, 3] - begin[:3, 3]) > _LONGEST_MM:
        return "unreachable"
    if np.trace(begin[:3, :3].T @ pose[:3, :3]) < 1 + 2 * np.cos(_HALF_TURN_RAD):
        return "ambiguous"
    try:
        line = straight_path(begin, pose, _ANY_MM_S).poses
        path = follow(arm, line, stands, "a move")
    except FileError:
        return "ambiguous"
    if conditioning(arm, path).min() < _PAST_SINGULARITY:
        return "past_singularity"
    end: Array = path[-1]
    return solutions[np.abs(solutions - end).max(axis=1).argmin()] if len(solutions) else "unreachable"
