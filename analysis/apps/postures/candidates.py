"""All postures that reach a target, within the joint limits and clear of singularities.

An arm of six axes has up to eight branches, each with the whole turns near a reference posture. For other numbers of
axes Newton's method starts from postures spread over the limits: it finds the isolated postures of four or five axes,
and samples those of a redundant arm. A rail is sampled by its position.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from analysis.correction.reasons import Reason
from analysis.robot.kinematics.arm import RAIL_MM, Arm, Array, Integers, Mask, forward
from analysis.robot.kinematics.inverse import branches, canonical, inverse
from analysis.robot.kinematics.joint_limits import SAME_RAD, within_limits, wrapped
from analysis.robot.kinematics.newton import conditioning, newton, newton_in_part, turned_rad
from rigs.schema.vocabulary import DRIVEN_AXES

LEAST_CONDITIONING = 0.01
"""Conditioning below which a posture counts as singular, as in the planning of poses (`pose_pool`)."""
_TURN_RAD = np.radians(195.0)
"""Distance of a joint from the reference posture up to which full turns are kept. Chosen: half a turn, plus 15° so
that a program can pass the half turn without returning.
"""
_STARTS = 48
"""Start values of an arm without a closed form for each target. Chosen: about a quarter converge within the limits of
a Franka.
"""
_SAME_SELF_MOTION_RAD = np.radians(3.0)
"""Distance below which two postures of a redundant arm are practically equal."""
_LARGEST_TURN_RAD = np.radians(0.5)
"""Deviation from the requested orientation up to which an arm of four or five axes reaches a pose. Chosen: a table
rounded to tenths of a degree, and an arm whose parallel axes are nearly parallel.
"""
_STANDS = 5
"""Number of rail positions that are tried, evenly over its travel."""
NO_BRANCH = -1
"""Branch of a posture if the arm has no known branches."""


@dataclass(frozen=True)
class Candidates:
    q: Array
    """Joint angles (m, axes) rad, followed by the rail position in m."""
    target: Integers
    solution: Integers
    branch: Integers
    """4 · shoulder + 2 · elbow + wrist (m,), or NO_BRANCH."""
    conditioning: Array
    """0 is singular."""
    reasons: dict[int, Reason]

    def of(self, rows: Mask | Integers) -> Candidates:
        return Candidates(
            self.q[rows], self.target[rows], self.solution[rows], self.branch[rows], self.conditioning[rows],
            self.reasons,
        )  # fmt: skip

    def groups(self) -> Iterator[tuple[int, slice]]:
        targets, begins = np.unique(self.target, return_index=True)
        ends = [*begins.tolist()[1:], len(self.target)] if len(begins) else []
        for target, begin, end in zip(targets.tolist(), begins.tolist(), ends, strict=True):
            yield target, slice(begin, end)


def find_candidates(arm: Arm, poses: Array, near: Array, rail_m: tuple[float, float] | None = None) -> Candidates:
    """Postures of an arm at tool poses (n, 4, 4) in the world.

    near: reference posture (axes,) rad for full turns. rail_m: travel of a rail in m, whose position is free.
    """
    stands = [None] if rail_m is None or arm.rail is None else np.linspace(*rail_m, _STANDS).tolist()
    parts, solutions = [], 0
    in_reach: Mask = np.zeros(len(poses), dtype=bool)
    for stand in stands:
        at_stand = arm
        if stand is not None and arm.rail is not None:
            T = arm.T_world_base.copy()
            T[:3, 3] += RAIL_MM * stand * arm.rail
            at_stand = replace(arm, T_world_base=T, rail=None)
        find = _branch_postures if arm.axes == DRIVEN_AXES else _sampled_postures
        q, target, solution, reached = find(at_stand, poses, near)
        in_reach |= reached
        q = q if stand is None else np.column_stack([q, np.full(len(q), stand)])
        parts.append((q, target, solution + solutions))
        solutions += int(solution.max(initial=0)) + 1
    q, target, solution = (np.concatenate(part) for part in zip(*parts, strict=True))
    order = np.argsort(target, kind="stable")
    q, target, solution = q[order], target[order], solution[order]
    regular = conditioning(arm, q) if len(q) else np.zeros(0)
    clear = regular > LEAST_CONDITIONING
    reasons: dict[int, Reason] = {}
    for k in sorted(set(range(len(poses))) - set(target[clear].tolist())):
        reasons[k] = "singular" if (target == k).any() else "beyond_limits" if in_reach[k] else "unreachable"
    branch = branch_of(arm, poses[target], q)
    return Candidates(q[clear], target[clear], solution[clear], branch[clear], regular[clear], reasons)


def branch_of(arm: Arm, poses: Array, q: Array) -> Integers:
    """Branch (m,) of postures q (m, axes) rad at their poses (m, 4, 4)."""
    form = canonical(arm) if arm.axes == DRIVEN_AXES and arm.rail is None else None
    if form is None or not len(q):
        return np.full(len(q), NO_BRANCH, dtype=np.int64)
    theta = branches(form, poses)
    turned = (q @ arm.coupling.T + arm.offset).T
    return np.asarray(np.abs(wrapped(theta - turned)).max(axis=1).argmin(axis=0), dtype=np.int64)


def _branch_postures(arm: Arm, poses: Array, near: Array) -> tuple[Array, Integers, Integers, Mask]:
    """Postures (m, 6) rad of six axes, their targets (m,), solution numbers (m,) and a mask (n,) of poses in reach."""
    solutions = inverse(arm, poses)
    target, slot = np.nonzero(solutions.found)
    q, row = within_limits(arm, solutions.q[target, slot])
    away = np.abs(q - near).max(axis=1)
    nearest = np.full(len(target), np.inf)
    np.minimum.at(nearest, row, away)
    kept = away <= np.maximum(_TURN_RAD, nearest[row] + SAME_RAD)
    reached = np.asarray(solutions.found.any(axis=1))
    return q[kept], target[row[kept]].astype(np.int64), row[kept].astype(np.int64), reached


def _sampled_postures(arm: Arm, poses: Array, near: Array) -> tuple[Array, Integers, Integers, Mask]:
    """The same as `_branch_postures` for an arm without a closed form.

    All poses have the same start values, so that neighbouring poses have neighbouring postures.
    """
    low, high = arm.limits.T
    starts = np.vstack([near, np.random.default_rng(0).uniform(low, high, (_STARTS, arm.axes))])
    target = np.repeat(np.arange(len(poses)), len(starts))
    solve = _newton_in_part if arm.axes < DRIVEN_AXES else newton
    q, converged = solve(arm, poses[target], np.tile(starts, (len(poses), 1)))
    in_reach: Mask = np.zeros(len(poses), dtype=bool)
    in_reach[target[converged]] = True
    q = low + np.mod(q - low, 2 * np.pi)  # the first turn above the lower limit
    inside = converged & (q <= high).all(axis=1)
    q = np.where(inside[:, None], q, np.nan).reshape(len(poses), len(starts), arm.axes)
    q, target = _distinct_postures(q)
    return q, target, np.arange(len(q)), in_reach


def _newton_in_part(arm: Arm, poses: Array, q: Array) -> tuple[Array, Mask]:
    """Newton's method for four or five axes, up to nearly the requested orientation."""
    q, reached = newton_in_part(arm, poses, q)
    turned = turned_rad(forward(arm, np.where(reached[:, None], q, 0.0)), poses)
    return q, reached & (turned < _LARGEST_TURN_RAD)


def _distinct_postures(q: Array) -> tuple[Array, Integers]:
    """Distinct postures (m, axes) of q (n, k, axes), without NaN, and their targets (m,)."""
    kept: Mask = np.asarray(np.isfinite(q).all(axis=2))
    for slot in range(1, q.shape[1]):
        with np.errstate(invalid="ignore"):
            apart = np.abs(q[:, :slot] - q[:, slot, None]).max(axis=2)
        kept[:, slot] &= ~((apart < _SAME_SELF_MOTION_RAD) & kept[:, :slot]).any(axis=1)
    return q[kept], np.nonzero(kept)[0].astype(np.int64)
