"""Inverse kinematics with all branches: every set of joint angles that puts the tool at a pose.

Strategy: an arm of a kind that has a closed form (`canonical`) gets its eight branches from it, exact. An
arm near such a kind, as calibration leaves it, gets the branches of the snapped arm as seeds of Newton's
method on the true arm. Any other arm gets Newton from a spread of seeds. Whatever its origin, a solution
counts only once forward kinematics gives the pose back.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from analysis.kinematics.arm import Arm, Array, Mask, forward, pose_error
from analysis.kinematics.canonical import Canonical, canonical
from analysis.kinematics.closed_form import branches
from analysis.kinematics.newton import newton
from analysis.kinematics.singularity import null_motion

TOLERANCE_MM, TOLERANCE_RAD = 1e-8, 1e-10
_POLISHED_MM = 1e-3
"""An error of a closed form below this comes from rounding, and a Newton step removes it; above it, from reach."""
_SAME_RAD = 1e-6
_SEEDS, _MOST = 96, 16
"""Seeds of the search, and how many solutions a general six-axis arm has at most (Raghavan and Roth 1993)."""
_ITERATIONS = 30
_BLOCK = 500
"""Poses at a time: what fits the processor's cache."""
_SPREADS = (0.0, 0.1)
"""rad between the two sides of a singularity of the snapped arm."""
_SINGULAR = 0.01
_ASIDE = np.array([-0.6, -0.15, -0.03, 0.03, 0.15, 0.6])
"""Conditioning below which a solution is taken as near a singularity, and rad to look to its sides."""


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
    solve = partial(_exact, arm, form) if form is not None and form.exact else partial(_searched, arm, form)
    blocks = [solve(poses[at : at + _BLOCK]) for at in range(0, max(1, len(poses)), _BLOCK)]
    q, found = (np.concatenate(parts) for parts in zip(*blocks, strict=True))
    return Solutions(q, found, complete=form is not None and form.exact)


def _exact(arm: Arm, form: Canonical, poses: Array) -> tuple[Array, Mask]:
    q = _joints(arm, branches(form, poses))
    error = _errors(arm, poses, q)
    found = _good(error)
    near = ~found & (np.abs(error) < _POLISHED_MM).all(axis=2)
    if near.any():
        row = np.nonzero(near)[0]
        q[near] = newton(arm, poses[row], q[near])[0]
        found[near] = _good(pose_error(forward(arm, q[near]), poses[row]))
    return _distinct(arm, q, found)


def _searched(arm: Arm, form: Canonical | None, poses: Array) -> tuple[Array, Mask]:
    """Newton from the branches of the snapped arm, or from a spread; up to 16 solutions, found ones first."""
    if form is None:
        theta: Array = np.broadcast_to(_spread(), (len(poses), _SEEDS, 6))
    else:
        theta = np.concatenate([branches(form, poses, spread) for spread in _SPREADS], axis=1)
    q, found = _first(*_reached(arm, poses, _joints(arm, theta)))
    seeds = _aside(arm, q, found)
    again = np.isfinite(seeds).any(axis=(1, 2))
    more, found_more = _reached(arm, poses[again], seeds[again])
    both = np.concatenate([q[again], more], axis=1), np.concatenate([found[again], found_more], axis=1)
    q[again], found[again] = _first(*_distinct(arm, *both))
    return q, found


def _aside(arm: Arm, q: Array, found: Mask) -> Array:
    """Seeds (n, s, 6) to both sides of each solution near a singularity, else nan.

    Branches lie close together there, along the joint motion that leaves the tool still, and the seeds of
    several may have run into one.
    """
    row, slot = np.nonzero(found)
    condition, still = null_motion(arm, q[row, slot])
    near = condition < _SINGULAR
    row, slot = row[near], slot[near]
    seeds = np.full((*q.shape[:2], len(_ASIDE), 6), np.nan)
    seeds[row, slot] = q[row, slot, None] + _ASIDE[:, None] * still[near, None]
    return seeds.reshape(len(q), q.shape[1] * len(_ASIDE), 6)


def _reached(arm: Arm, poses: Array, seeds: Array) -> tuple[Array, Mask]:
    """Where Newton gets to from seeds (n, k, 6), each solution once; nan seeds lead nowhere."""
    n, k, _ = seeds.shape
    q = newton(arm, np.repeat(poses, k, axis=0), seeds.reshape(-1, 6), _ITERATIONS)[0].reshape(n, k, 6)
    q = _joints(arm, q @ arm.coupling.T + arm.offset)
    return _distinct(arm, q, _good(_errors(arm, poses, q)))


def _first(q: Array, found: Mask) -> tuple[Array, Mask]:
    """At most 16 slots, the found ones first, in their order."""
    order = np.argsort(~found, axis=1, kind="stable")[:, :_MOST]
    return np.take_along_axis(q, order[..., None], axis=1), np.take_along_axis(found, order, axis=1)


def _spread() -> Array:
    """Seeds (s, 6) rad that fill the six turns evenly: the additive recurrence of M. Roberts (2018)."""
    root = 1.0
    for _ in range(50):
        root = (1 + root) ** (1 / 7)
    steps = root ** -np.arange(1.0, 7.0)
    filled: Array = 2 * np.pi * ((np.arange(1, _SEEDS + 1)[:, None] * steps) % 1.0) - np.pi
    return filled


def _joints(arm: Arm, theta: Array) -> Array:
    """q (…, 6) of theta (…, 6), whole turns taken out of coupling @ q."""
    q: Array = _wrapped(theta - arm.offset) @ np.linalg.inv(arm.coupling).T
    return q


def _wrapped(angle: Array) -> Array:
    """The same angles in (-180°, 180°]."""
    wrapped: Array = angle - 2 * np.pi * np.ceil(angle / (2 * np.pi) - 0.5)
    return wrapped


def _errors(arm: Arm, poses: Array, q: Array) -> Array:
    """Pose errors (n, k, 6) of q (n, k, 6)."""
    n, k, _ = q.shape
    return pose_error(forward(arm, q.reshape(-1, 6)), np.repeat(poses, k, axis=0)).reshape(n, k, 6)


def _good(error: Array) -> Mask:
    good: Mask = (np.linalg.norm(error[..., :3], axis=-1) < TOLERANCE_MM) & (
        np.linalg.norm(error[..., 3:], axis=-1) < TOLERANCE_RAD
    )
    return good


def _distinct(arm: Arm, q: Array, found: Mask) -> tuple[Array, Mask]:
    """The same without the solutions that an earlier slot has already; empty slots are nan."""
    found = found.copy()
    turned = q @ arm.coupling.T
    for slot in range(1, q.shape[1]):
        apart = np.abs(_wrapped(turned[:, :slot] - turned[:, slot, None])).max(axis=2)
        found[:, slot] &= ~((apart < _SAME_RAD) & found[:, :slot]).any(axis=1)
    return np.where(found[..., None], q, np.nan), found
