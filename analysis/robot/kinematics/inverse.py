"""Inverse kinematics with all branches: every set of joint angles for a tool pose.

An arm with a closed form (`canonical`) has eight exact branches. For other arms, solutions are searched (`searched`) by
Newton's method on stacks of start values. Every solution is confirmed by forward kinematics.

For a calibrated arm close to a kind, the start values are the branches of the snapped arm. More start values are used
in doubtful cases: near a singularity, near the end of the reach, and for arms of no known kind. These include values on
both sides of each solution near a singularity.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from analysis.robot.kinematics.arm import Arm, Array, Mask, blocks
from analysis.robot.kinematics.closed_form import Canonical, branches, canonical
from analysis.robot.kinematics.joint_limits import distinct, good, may_have_duplicates, off_by, wrapped
from analysis.robot.kinematics.newton import TOLERANCE_MM, from_nearby, newton, null_motion

_SEEDS, _MOST = 96, 16
"""Number of start values, and largest number of solutions of a general six-axis arm (Raghavan and Roth 1993)."""
_ITERATIONS = 30
_BEYOND = 1.5
"""Multiple of the largest snapping motion beyond which a branch is out of reach. A factor of 1 would suffice,
because the difference is the missing reach.
"""
_REGULAR = 2e-3
"""Regularity below which a branch of the snapped arm is doubtful: the true arm may then have additional solutions."""
_SPREAD = 0.1
"""Angle in rad between start values on the two sides of a singularity of the snapped arm."""
_SINGULAR = 0.01
_ASIDE = np.array([-0.6, -0.15, -0.03, 0.03, 0.15, 0.6])
"""Conditioning below which a solution is singular, and distances in rad of the start values on both sides of it."""


def searched(arm: Arm, form: Canonical | None, poses: Array) -> tuple[Array, Mask]:
    """Solve poses (n, 4, 4) by Newton: q (n, 16, 6) rad, and solved (n, 16) with solved slots first.

    Start values are the branches of the snapped arm, or spread evenly if the arm is of no known kind.
    """
    q, solved = np.full((len(poses), _MOST, 6), np.nan), np.zeros((len(poses), _MOST), dtype=bool)
    if form is None:
        # Start values (s, 6) rad that fill the six turns evenly: the additive recurrence of M. Roberts (2018).
        root = 1.0
        for _ in range(50):
            root = (1 + root) ** (1 / 7)
        steps = root ** -np.arange(1.0, 7.0)
        filled: Array = 2 * np.pi * ((np.arange(1, _SEEDS + 1)[:, None] * steps) % 1.0) - np.pi
        theta: Array = np.broadcast_to(filled, (len(poses), _SEEDS, 6))
        return _add_singular_solutions(arm, poses, *_first(*_reached(arm, poses, _joints(arm, theta))))
    theta = branches(form, poses)
    q[:, :8], solved[:, :8], clear = _near_branches(arm, form, poses, theta)
    doubtful = np.flatnonzero(~clear)
    if len(doubtful):
        # Branches without success, and separated sides of a singularity if they differ from the branches.
        snapped, apart = theta[:, :, doubtful], branches(form, poses[doubtful], _SPREAD)
        has_moved = (np.abs(wrapped(apart - snapped)).max(axis=1) > 0).T
        seeds = _joints(arm, np.concatenate([snapped, apart]).transpose(2, 0, 1))
        seeds = distinct(arm, seeds, np.concatenate([~solved[doubtful, :8], has_moved], axis=1))[0]
        more = _reached(arm, poses[doubtful], seeds)
        q[doubtful], solved[doubtful] = _add_singular_solutions(
            arm, poses[doubtful], *_together(arm, q[doubtful], solved[doubtful], *more)
        )
    return _first(q, solved)


def _near_branches(arm: Arm, form: Canonical, poses: Array, theta: Array) -> tuple[Array, Mask, Mask]:
    """Refine each branch theta (8, 6, n) rad of the snapped arm by Newton: q (n, 8, 6), solved (n, 8), clear (n,).

    A pose is clear if all branches are far from the end of the reach, from each other, and from singularities.
    """
    seeds = _joints(arm, theta.transpose(2, 0, 1))
    flat = np.repeat(poses, 8, axis=0)
    reached, off_mm, regularity = from_nearby(arm, flat, seeds.reshape(-1, 6), _BEYOND * form.snapped_mm)
    turned = wrapped(reached @ arm.coupling.T)
    q: Array = turned @ np.linalg.inv(arm.coupling).T
    solved, tried = off_mm < TOLERANCE_MM, off_mm < np.inf
    unsure = np.flatnonzero(tried & ~solved)
    solved[unsure] = good(*off_by(arm, flat[unsure], q[unsure].T[None]))[0]
    q[~solved] = np.nan
    regular = (solved & (regularity >= _REGULAR)) | ~tried
    clear = regular.reshape(-1, 8).all(axis=1)
    clear &= ~may_have_duplicates(turned.reshape(-1, 8, 6).transpose(1, 2, 0), solved.reshape(-1, 8).T)
    return q.reshape(-1, 8, 6), solved.reshape(-1, 8), clear


def _add_singular_solutions(arm: Arm, poses: Array, q: Array, solved: Mask) -> tuple[Array, Mask]:
    """Add solutions on both sides of singular ones: q (n, 16, 6) rad, solved (n, 16).

    Near a singularity, branches are close together, along the joint motion that does not move the tool. Several start
    values may have converged to the same branch.
    """
    row, slot = np.nonzero(solved)
    condition, still = null_motion(arm, q[row, slot])
    near = condition < _SINGULAR
    row, slot = row[near], slot[near]
    seeds = np.full((*q.shape[:2], len(_ASIDE), 6), np.nan)
    seeds[row, slot] = q[row, slot, None] + _ASIDE[:, None] * still[near, None]
    seeds = seeds.reshape(len(q), q.shape[1] * len(_ASIDE), 6)
    again = np.isfinite(seeds).any(axis=(1, 2))
    more = _reached(arm, poses[again], seeds[again])
    q[again], solved[again] = _together(arm, q[again], solved[again], *more)
    return q, solved


def _together(arm: Arm, q: Array, solved: Mask, more: Array, solved_more: Mask) -> tuple[Array, Mask]:
    """Merge solutions q (n, k, 6) rad, solved (n, k) with additional ones, and remove duplicates."""
    both = np.concatenate([q, more], axis=1), np.concatenate([solved, solved_more], axis=1)
    return _first(*distinct(arm, *_first(*both, most=None)))


def _reached(arm: Arm, poses: Array, seeds: Array) -> tuple[Array, Mask]:
    row, slot = np.nonzero(np.isfinite(seeds).all(axis=2))
    q_reached = newton(arm, poses[row], seeds[row, slot], _ITERATIONS)[0]
    q_reached = _joints(arm, q_reached @ arm.coupling.T + arm.offset)
    q, solved = np.full(seeds.shape, np.nan), np.zeros(seeds.shape[:2], dtype=bool)
    q[row, slot], solved[row, slot] = q_reached, good(*off_by(arm, poses[row], q_reached.T[None]))[0]
    return distinct(arm, *_first(q, solved, most=None))


def _first(q: Array, solved: Mask, most: int | None = _MOST) -> tuple[Array, Mask]:
    """At most `most` slots with solved ones first, in order. If `most` is None, all solved ones are returned."""
    most = most or max(_MOST, int(solved.sum(axis=1).max(initial=0)))
    order = np.argsort(~solved, axis=1, kind="stable")[:, :most]
    return np.take_along_axis(q, order[..., None], axis=1), np.take_along_axis(solved, order, axis=1)


def _joints(arm: Arm, theta: Array) -> Array:
    q: Array = wrapped(theta - arm.offset) @ np.linalg.inv(arm.coupling).T
    return q


_POLISHED_MM = 1e-3
"""Largest rounding error of a closed form, which a Newton step removes. A larger error is missing reach."""
_BLOCK = 1000
"""Poses per block, which fit into the processor's cache."""


@dataclass(frozen=True)
class Solutions:
    """Solutions q (n, k, 6) rad, nan in empty slots. found (n, k): mask of solutions.

    complete: True if the arm has an exact closed form. All branches are then present; at a singular pose they are a
    choice of infinitely many. A slot identifies the branch: 4 · shoulder + 2 · elbow + wrist. If False, slots have no
    meaning, and solutions may be missing: near a singularity of a calibrated arm, and anywhere for an arm of no known
    kind.
    """

    q: Array
    found: Mask
    complete: bool


def inverse(arm: Arm, poses: Array) -> Solutions:
    """All branches for tool poses (n, 4, 4) in the world: k = 8 with a closed form, otherwise 16.

    Each solution reproduces its pose within 1e-8 mm and 1e-10 rad. Full turns are removed: coupling @ q is in (-180°,
    180°]. Joint limits are ignored; `within_limits` adds turns and filters. An unreachable or non-finite pose has no
    solution, and no error is raised. At a singular wrist, theta4 corresponds to t4 = 0 (`closed_form.branches`).
    Coinciding branches are returned once.
    """
    form = canonical(arm)
    solve = partial(_exact, arm, form) if form is not None and form.exact else partial(searched, arm, form)
    finite = np.where(np.isfinite(poses), poses, np.nan)  # nan is processed silently, infinity is not
    parts = [solve(finite[block]) for block in blocks(max(1, len(poses)), _BLOCK)]
    q, solved = (np.concatenate(part) for part in zip(*parts, strict=True))
    return Solutions(q, solved, complete=form is not None and form.exact)


def _exact(arm: Arm, form: Canonical, poses: Array) -> tuple[Array, Mask]:
    turned = wrapped(branches(form, poses) - arm.offset[:, None])
    q: Array = np.linalg.inv(arm.coupling) @ turned
    mm, rad = off_by(arm, poses, q)
    solved = good(mm, rad)
    near = ~solved & (mm < _POLISHED_MM) & (rad < _POLISHED_MM)
    q = np.ascontiguousarray(q.transpose(2, 0, 1))
    solved = np.ascontiguousarray(solved.T)
    if near.any():
        slot, row = np.nonzero(near)
        polished = newton(arm, poses[row], q[row, slot])[0]
        q[row, slot] = polished
        solved[row, slot] = good(*off_by(arm, poses[row], polished.T[None]))[0]
    twins = np.flatnonzero(may_have_duplicates(turned, solved.T))
    solved[twins] = distinct(arm, q[twins], solved[twins])[1]
    q[~solved] = np.nan
    return q, solved
