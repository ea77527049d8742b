"""Best sequence of postures along a program: small errors, few changes of branch, short joint travel.

Within a program each joint approaches from the previous posture, so the sign of its backlash is known.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from analysis.apps.postures.candidates import LEAST_CONDITIONING, NO_BRANCH, Candidates
from analysis.apps.postures.expected_error import PostureErrors
from analysis.robot.kinematics.arm import Array, Integers, Mask

CHANGE = 0.5
"""Cost of a change of branch, in errors of a mean target. Chosen: a change is worthwhile if it halves the error of
one target, or reduces the error of ten targets by a twentieth.
"""
TRAVEL = 0.1
"""Cost of a radian of the joint that moves most, in errors of a mean target. Chosen: half a turn costs a third."""
_SINGULAR = 1e3
"""Cost of a singular posture, the last choice. Only the table of an existing program can contain one."""
_STAYS_RAD = 1e-9
"""Smallest motion that determines the side of approach of a joint."""


@dataclass(frozen=True)
class Sequence:
    """A posture for each target in program order."""

    rows: Integers
    expected_mm: Array
    """Expected error (t,), with the side of approach given by the program."""
    changes: int
    travel_rad: float
    """Sum over all moves of the largest joint motion."""

    @property
    def rms_mm(self) -> float:
        """Expected rms error over the program."""
        return float(np.sqrt(np.mean(self.expected_mm**2))) if len(self.rows) else float("nan")


def best_sequence(
    candidates: Candidates, errors: PostureErrors, *, change: float = CHANGE, travel: float = TRAVEL, error: float = 1.0
) -> Sequence:
    """Sequence with the smallest sum of errors and costs, all in errors of a mean target, by dynamic programming.

    error: weight of the errors; 0 gives the sequence that a user would choose without knowing them.
    """
    groups = [slice_ for _, slice_ in candidates.groups()]
    if not groups:
        return Sequence(np.zeros(0, dtype=np.int64), np.zeros(0), 0, 0.0)
    smallest = [errors.expected_mm[rows].min() for rows in groups]
    unit = max(float(np.sqrt(np.mean(np.square(smallest)))), 1e-12)
    singular = _SINGULAR * (candidates.conditioning <= LEAST_CONDITIONING)
    cost = singular[groups[0]] + error * errors.expected_mm[groups[0]] / unit
    came_from = []
    for before, rows in pairwise(groups):
        away = candidates.q[None, rows] - candidates.q[before, None]
        moves = np.abs(away).max(axis=2)
        repeated = errors.of(np.tile(np.arange(rows.start, rows.stop), len(away)))
        approached = _after(repeated, away.reshape(-1, away.shape[2])).reshape(len(away), -1)
        price = error * approached / unit + travel * moves
        price += singular[rows] + change * _changed(candidates.branch[before, None], candidates.branch[None, rows])
        whole = cost[:, None] + price
        came_from.append(whole.argmin(axis=0))
        cost = whole.min(axis=0)
    chosen = [int(cost.argmin())]
    for back in reversed(came_from):
        chosen.append(int(back[chosen[-1]]))
    picked = np.array([rows.start + k for rows, k in zip(groups, reversed(chosen), strict=True)], dtype=np.int64)
    return sequence_of(candidates, errors, picked)


def sequence_of(candidates: Candidates, errors: PostureErrors, rows: Integers) -> Sequence:
    q, branch = candidates.q[rows], candidates.branch[rows]
    expected = errors.expected_mm[rows].copy()
    away = np.diff(q, axis=0)
    expected[1:] = _after(errors.of(rows[1:]), away)
    return Sequence(rows, expected, int(_changed(branch[:-1], branch[1:]).sum()), float(np.abs(away).max(axis=1).sum()))


def _changed(before: Integers, after: Integers) -> Mask:
    return np.asarray((before != after) & (before != NO_BRANCH) & (after != NO_BRANCH))


def _after(errors: PostureErrors, away: Array) -> Array:
    """Expected errors (m,) mm after motions (m, axes) rad; the side of a joint at rest is unknown."""
    moved = away[:, : errors.rising_mm.shape[1]]
    return errors.from_sides(np.where(np.abs(moved) > _STAYS_RAD, np.sign(moved), 0.0))
