"""The joint angles at which the nominal arm reaches the targets of a program.

A pose has up to eight postures, and the correction differs from one to another; so a target without a certain posture
is left. Certain are, in this order: joint angles that the program names beside the pose (UR's qnear), flags of posture
that exactly one solution has, and the way from the target before it in the same block, along which the arm keeps its
posture.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analysis.correction.programs.flags import agreeing
from analysis.correction.programs.target import Reason, Step, Target
from analysis.kinematics.arm import Arm, Array, forward
from analysis.kinematics.follow import follow
from analysis.kinematics.inverse import inverse
from analysis.kinematics.limits import within_limits
from analysis.robot_programs.ways import straight
from rigs.errors import FileError

_NEAR_RAD = np.radians(60.0)
"""The largest joint way to the nearest solution that still says which one is meant. Chosen: other postures turn a wrist
joint by 180° less than twice axis 5."""
_CLEARLY = 2.0
"""The next solution is farther by this factor than the nearest, or which one is meant is not clear. Chosen."""
_SAME_RAD = 1e-6
_ANY_MM_S = 100.0
"""A way has the same places at any speed."""
_LONGEST_MM = 1e4
"""No line of an arm is longer: 10 m."""


def solved(
    arm: Arm, targets: Sequence[Target], poses: Array, given: Array, steps: Sequence[Step]
) -> tuple[Array, dict[int, Reason]]:
    """Return joint angles (n, 6) rad of targets, with the reason where there are none.

    `poses` (n, 4, 4) are those of the arm's tool in the world, and `given` (n, 6) rad the angles of joint targets, each
    nan where the target is of the other kind.
    """
    q = given.copy()
    reasons: dict[int, Reason] = {}
    asked = [k for k, one in enumerate(targets) if not one.joints and np.isfinite(poses[k]).all()]
    branches = dict(zip(asked, _branches(arm, poses[asked]), strict=True)) if asked else {}
    for k in asked:
        found, target = branches[k], targets[k]
        if isinstance(found, str):
            reasons[k] = found
        elif target.near is not None:
            _take(q, reasons, k, _nearest(found, np.array(target.near)))
        elif target.flags:
            mask = agreeing(arm, found, target.flags)
            one = found[mask][0] if mask.sum() == 1 else None
            _take(q, reasons, k, one if one is not None else ("ambiguous" if mask.any() else "other_flags"))
    _along(arm, targets, poses, branches, steps, q, reasons)
    for k in asked:
        if k not in reasons and not np.isfinite(q[k]).all():
            reasons[k] = "no_posture"
    return q, reasons


def _branches(arm: Arm, poses: Array) -> list[Array | Reason]:
    """Return all solutions (m, 6) rad of each pose within the limits, with their turns, or why there are none."""
    solutions = inverse(arm, poses)
    every: list[Array | Reason] = []
    for q, found in zip(solutions.q, solutions.found, strict=True):
        if not found.any():
            every.append("unreachable")
            continue
        allowed, _ = within_limits(arm, q[found])
        every.append(allowed if len(allowed) else "beyond_limits")
    return every


def _take(q: Array, reasons: dict[int, Reason], k: int, found: Array | Reason) -> None:
    if isinstance(found, str):
        reasons[k] = found
    else:
        q[k] = found


def _nearest(found: Array, near: Array) -> Array | Reason:
    """Return the solution (6,) rad nearest to angles (6,) rad, if it is clear which one that is."""
    away = np.abs(found - near).max(axis=1)
    order = np.argsort(away)
    if away[order[0]] > _NEAR_RAD or (len(order) > 1 and away[order[1]] < _CLEARLY * away[order[0]]):
        return "ambiguous"
    nearest: Array = found[order[0]]
    return nearest


def _along(
    arm: Arm,
    targets: Sequence[Target],
    poses: Array,
    branches: dict[int, Array | Reason],
    steps: Sequence[Step],
    q: Array,
    reasons: dict[int, Reason],
) -> None:
    """Go through the moves in the order of the text, and take postures from the target before where nothing else says
    them."""
    stands: Array | None = None
    by_way: set[int] = set()
    anywhere: set[int] = set()
    for step in steps:
        k = step.target
        if k is None:
            stands = None
            continue
        target = targets[k]
        free = not target.joints and target.near is None and target.flags is None
        found = branches.get(k)
        if free and stands is not None and found is not None and not isinstance(found, str) and k not in reasons:
            there = _reached(arm, stands, poses[k], found, linear=step.way == "line")
            if isinstance(there, str):
                if k not in by_way:
                    reasons[k] = there
            elif k in by_way and np.abs(q[k] - there).max() > _SAME_RAD:
                reasons[k] = "two_postures"
            else:
                q[k] = there
                by_way.add(k)
        elif free and stands is None:
            anywhere.add(k)
        elif _turned_over(arm, step, stands, poses[k], found, q[k]):
            reasons[k] = "two_postures"
        stands = q[k] if k not in reasons and np.isfinite(q[k]).all() else None
    reasons.update(dict.fromkeys(by_way & anywhere, "two_postures"))


def _turned_over(
    arm: Arm, step: Step, stands: Array | None, pose: Array, found: Array | Reason | None, q: Array
) -> bool:
    """Whether a line from angles `stands` (6,) rad leads to another posture at a pose (4, 4) than q (6,) rad: then the
    flags are not those with which the arm arrives."""
    if step.way != "line" or stands is None or found is None or isinstance(found, str) or not np.isfinite(q).all():
        return False
    there = _reached(arm, stands, pose, found, linear=True)
    return not isinstance(there, str) and bool(np.abs(np.sin((there - q) / 2)).max() > _SAME_RAD)


def _reached(arm: Arm, stands: Array, pose: Array, found: Array, *, linear: bool) -> Array | Reason:
    """Return the angles (6,) rad at a pose (4, 4) for an arm that comes from angles `stands` (6,) rad."""
    if not linear:
        return _nearest(found, stands)
    begin = forward(arm, stands[None])[0]
    if np.linalg.norm(pose[:3, 3] - begin[:3, 3]) > _LONGEST_MM:
        return "unreachable"
    try:
        way = straight(begin, pose, _ANY_MM_S).poses
        end: Array = follow(arm, way, stands, "a move")[-1]
    except FileError:
        return "ambiguous"
    return found[np.abs(found - end).max(axis=1).argmin()] if len(found) else "unreachable"
