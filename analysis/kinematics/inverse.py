"""Inverse kinematics with all branches: every set of joint angles that puts the tool at a pose.

Strategy: an arm of a kind that has a closed form (`canonical`) gets its eight branches from it, exact. Any other arm
is searched (`search`). Whatever its origin, a solution counts only once forward kinematics gives the pose back.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from analysis.kinematics.arm import Arm, Array, Mask, blocks
from analysis.kinematics.closed_form import Canonical, branches, canonical
from analysis.kinematics.limits import distinct, good, may_hold_twins, off_by, wrapped
from analysis.kinematics.newton import newton
from analysis.kinematics.search import searched

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
