"""Inverse kinematics with all branches: every set of joint angles that puts the tool at a pose.

Strategy: an arm of a kind that has a closed form (`canonical`) gets its eight branches from it, exact. Any other arm is
searched (`search`), by Newton's method on stacks of seeds. Whatever its origin, a solution counts only once forward
kinematics gives the pose back.

An arm near a kind that has one, as calibration leaves it, gets the branches of the snapped arm as seeds, all at once.
Where this leaves a doubt, near a singularity or the end of a reach, and for an arm of no known kind, there are more
seeds, and again some to both sides of each solution near a singularity.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from analysis.robot.kinematics.arm import Arm, Array, Mask, blocks
from analysis.robot.kinematics.closed_form import Canonical, branches, canonical
from analysis.robot.kinematics.joint_limits import distinct, good, may_hold_twins, off_by, wrapped
from analysis.robot.kinematics.newton import TOLERANCE_MM, from_nearby, newton, null_motion

_SEEDS, _MOST = 96, 16
"""Seeds of the search, and how many solutions a general six-axis arm has at most (Raghavan and Roth 1993)."""
_ITERATIONS = 30
_BEYOND = 1.5
"""A branch that misses by more than so many times what snapping can move the tool is out of reach. Once would do: it
misses by what the reach lacks."""
_REGULAR = 2e-3
"""Regularity below which a branch of the snapped arm leaves a doubt: the true arm may have more solutions beside it."""
_SPREAD = 0.1
"""rad between the two sides of a singularity of the snapped arm, where they are held apart."""
_SINGULAR = 0.01
_ASIDE = np.array([-0.6, -0.15, -0.03, 0.03, 0.15, 0.6])
"""Conditioning below which a solution is taken as near a singularity, and rad to look to its sides."""


def searched(arm: Arm, form: Canonical | None, poses: Array) -> tuple[Array, Mask]:
    """q (n, 16, 6) rad and solved (n, 16) for poses (n, 4, 4), by Newton from the branches of the snapped arm, or a
    spread; solved ones first."""
    q, solved = np.full((len(poses), _MOST, 6), np.nan), np.zeros((len(poses), _MOST), dtype=bool)
    if form is None:
        # Seeds (s, 6) rad that fill the six turns evenly: the additive recurrence of M. Roberts (2018).
        root = 1.0
        for _ in range(50):
            root = (1 + root) ** (1 / 7)
        steps = root ** -np.arange(1.0, 7.0)
        filled: Array = 2 * np.pi * ((np.arange(1, _SEEDS + 1)[:, None] * steps) % 1.0) - np.pi
        theta: Array = np.broadcast_to(filled, (len(poses), _SEEDS, 6))
        return _beside(arm, poses, *_first(*_reached(arm, poses, _joints(arm, theta))))
    theta = branches(form, poses)
    q[:, :8], solved[:, :8], clear = _near_branches(arm, form, poses, theta)
    doubtful = np.flatnonzero(~clear)
    if len(doubtful):
        # The branches that led to no solution, and what becomes of them where the two sides of a singularity are held
        # apart, where that is anything new.
        snapped, apart = theta[:, :, doubtful], branches(form, poses[doubtful], _SPREAD)
        has_moved = (np.abs(wrapped(apart - snapped)).max(axis=1) > 0).T
        seeds = _joints(arm, np.concatenate([snapped, apart]).transpose(2, 0, 1))
        seeds = distinct(arm, seeds, np.concatenate([~solved[doubtful, :8], has_moved], axis=1))[0]
        more = _reached(arm, poses[doubtful], seeds)
        q[doubtful], solved[doubtful] = _beside(
            arm, poses[doubtful], *_together(arm, q[doubtful], solved[doubtful], *more)
        )
    return _first(q, solved)


def _near_branches(arm: Arm, form: Canonical, poses: Array, theta: Array) -> tuple[Array, Mask, Mask]:
    """Newton from each branch theta (8, 6, n) of the snapped arm that can be near a solution: q (n, 8, 6), solved
    (n, 8), and which poses (n,) are clear: no branch is near the end of its reach or another one, none near a
    singularity."""
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
    clear &= ~may_hold_twins(turned.reshape(-1, 8, 6).transpose(1, 2, 0), solved.reshape(-1, 8).T)
    return q.reshape(-1, 8, 6), solved.reshape(-1, 8), clear


def _beside(arm: Arm, poses: Array, q: Array, solved: Mask) -> tuple[Array, Mask]:
    """Solutions q (n, 16, 6) and solved (n, 16), with those to both sides of each that is near a singularity.

    Branches lie close together there, along the joint motion that leaves the tool still, and the seeds of
    several may have run into one.
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
    """Solutions q (n, k, 6), solved (n, k) and more, each once."""
    both = np.concatenate([q, more], axis=1), np.concatenate([solved, solved_more], axis=1)
    return _first(*distinct(arm, *_first(*both, most=None)))


def _reached(arm: Arm, poses: Array, seeds: Array) -> tuple[Array, Mask]:
    """Where Newton gets to from seeds (n, k, 6), each solution once; nan seeds lead nowhere."""
    row, slot = np.nonzero(np.isfinite(seeds).all(axis=2))
    q_reached = newton(arm, poses[row], seeds[row, slot], _ITERATIONS)[0]
    q_reached = _joints(arm, q_reached @ arm.coupling.T + arm.offset)
    q, solved = np.full(seeds.shape, np.nan), np.zeros(seeds.shape[:2], dtype=bool)
    q[row, slot], solved[row, slot] = q_reached, good(*off_by(arm, poses[row], q_reached.T[None]))[0]
    return distinct(arm, *_first(q, solved, most=None))


def _first(q: Array, solved: Mask, most: int | None = _MOST) -> tuple[Array, Mask]:
    """At most so many slots, the solved ones first, in their order; without `most` as many as hold all."""
    most = most or max(_MOST, int(solved.sum(axis=1).max(initial=0)))
    order = np.argsort(~solved, axis=1, kind="stable")[:, :most]
    return np.take_along_axis(q, order[..., None], axis=1), np.take_along_axis(solved, order, axis=1)


def _joints(arm: Arm, theta: Array) -> Array:
    """q (…, 6) of theta (…, 6), whole turns taken out of coupling @ q."""
    q: Array = wrapped(theta - arm.offset) @ np.linalg.inv(arm.coupling).T
    return q


_POLISHED_MM = 1e-3
"""An error of a closed form below this comes from rounding, and a Newton step removes it; above it, from reach."""
_BLOCK = 1000
"""Poses at a time: what fits the processor's cache."""


@dataclass(frozen=True)
class Solutions:
    """q (n, k, 6) rad, nan where there is no solution; found (n, k): where there is one.

    complete: the arm has a closed form, so no branch is missing (at a singular pose, a choice of the
    infinitely many), and a slot keeps its branch, 4 · shoulder + 2 · elbow + wrist. Otherwise the slots have
    no meaning, and a solution may be missing: near a singularity of a calibrated arm, anywhere for an arm
    of no known kind.
    """

    q: Array
    found: Mask
    complete: bool


def inverse(arm: Arm, poses: Array) -> Solutions:
    """All branches for tool poses (n, 4, 4) in the world: k = 8 with a closed form, else 16.

    Each solution gives its pose back within 1e-8 mm and 1e-10 rad. Whole turns are left out: coupling @ q
    lies in (-180°, 180°], joint limits are not looked at; `within_limits` turns and sifts. A pose out of
    reach, or not finite, has no solution; nothing is raised. At a singular wrist theta4 is the one of the
    choice t4 = 0 (`closed_form.branches`), and branches that fall together are given once.
    """
    form = canonical(arm)
    solve = partial(_exact, arm, form) if form is not None and form.exact else partial(searched, arm, form)
    finite = np.where(np.isfinite(poses), poses, np.nan)  # what is not a number passes through in silence, infinity not
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
    twins = np.flatnonzero(may_hold_twins(turned, solved.T))
    solved[twins] = distinct(arm, q[twins], solved[twins])[1]
    q[~solved] = np.nan
    return q, solved
