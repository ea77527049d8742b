"""The joint angles that a controller computes at the targets of a program.

A target with an uncertain posture is not corrected. The posture is determined, in this order, by joint angles in the
program near the pose, by posture flags that only a single solution matches, or by the moves from all previous targets,
along which the arm keeps the posture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypeGuard

import numpy as np

from analysis.apps.makers.target import AT_BEGIN, Arc, Flags, Target, TargetMove, Way
from analysis.apps.makers.tool_paths import circular_path, rotations, straight_path
from analysis.correction.reasons import Reason
from analysis.correction.table_postures import closest_solution, solutions_within_limits
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


def solved(
    arm: Arm,
    targets: Sequence[Target],
    poses: Array,
    joint_angles: Array,
    steps: Sequence[TargetMove],
    start: Sequence[float] | None = None,
    tips: Array | None = None,
) -> tuple[Array, dict[int, Reason]]:
    """Solve the joint angles (n, 6) rad of targets, with the reasons for missing ones.

    poses (n, 4, 4): poses of the arm's tool in the world, NaN for joint targets. joint_angles (n, 6): rad, NaN for
    poses. start (6,): rad, if known. tips (n, 3): points that the program moves, in mm in the arm's tool.
    """
    q = np.vstack([joint_angles, np.full(6, np.nan) if start is None else start])  # The last row has index AT_BEGIN.
    poses = poses.copy()
    asked = [k for k, target in enumerate(targets) if not target.joints and np.isfinite(poses[k]).all()]
    lines = {step.target for step in steps if step.way == "line" and targets[step.target].joints}
    by_line = [k for k in sorted(lines) if np.isfinite(q[k]).all()]  # A line to joint angles ends at their pose.
    poses[by_line] = forward(arm, q[by_line])
    branches: dict[int, Array | Reason] = {
        k: of if isinstance(of, str) else of.q
        for k, of in zip([*asked, *by_line], solutions_within_limits(arm, poses[[*asked, *by_line]]), strict=True)
    }
    postures = _Postures(arm, targets, poses, branches, q, np.zeros((len(targets), 3)) if tips is None else tips)
    for k in asked:
        solutions, target = branches[k], targets[k]
        if isinstance(solutions, str):
            postures.take(k, solutions)
        elif target.near is not None:
            postures.take(k, _nearest(solutions, np.array(target.near)))
        elif target.flags:
            chosen = solutions[agreeing(arm, solutions, target.flags)]
            postures.take(k, chosen[0] if len(chosen) == 1 else "ambiguous" if len(chosen) else "other_flags")
    postures.derive(steps)
    for k in asked:
        if k not in postures.reasons and not postures.is_solved(k):
            postures.take(k, "no_posture")
    return q[:AT_BEGIN], postures.reasons


def _nearest(solutions: Array, near: Array) -> Array | Reason:
    """Solution (6,) rad nearest to angles (6,) rad, or the reason if it is ambiguous."""
    away = np.abs(solutions - near).max(axis=1)
    first, *second = np.sort(away)[:2]
    if first > _NEAR_RAD or (second and second[0] < _CLEARLY * first):
        return "ambiguous"
    nearest: Array = solutions[away.argmin()]
    return nearest


def _closest(solutions: Array, stands: Array) -> Array | Reason:
    closest = closest_solution(solutions, stands)
    return "ambiguous" if closest is None else closest


@dataclass
class _Postures:
    """The postures at the targets of a program during the search, and the reasons for missing ones."""

    arm: Arm
    targets: Sequence[Target]
    poses: Array
    branches: dict[int, Array | Reason]
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
            self.arrivals[key] = _reached(self.arm, self.q[source], self.poses[k], solutions, way)
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
