"""Postures of a program: all that reach each target, their best sequence, and the best place of a part."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from analysis.apps.postures.candidates import NO_BRANCH, Candidates, branch_of, find_candidates
from analysis.apps.postures.expected_error import Knowledge, PostureErrors, expected_errors, knowledge_of
from analysis.apps.postures.sequence import CHANGE, Sequence, best_sequence, sequence_of
from analysis.apps.postures.work_map import WorkMap, work_map
from analysis.correction.pose_uncertainty import pose_uncertainty
from analysis.correction.support import supports, why_nothing
from analysis.correction.work import FEWEST_TAUGHT, work_or_spread
from analysis.robot.kinematics.arm import RAIL_MM, Arm, Array, Mask, arm_of
from analysis.robot.kinematics.newton import conditioning
from rigs.rig import Rig

_SAME_RAD = np.radians(0.5)
"""Largest difference between a candidate and the posture in a table of joint angles."""


@dataclass(frozen=True)
class Postures:
    """Postures of targets with their errors, and two sequences of them."""

    rig: Rig
    poses: Array
    knowledge: Knowledge
    verdict: str
    candidates: Candidates
    errors: PostureErrors
    best: Sequence
    """Sequence with the smallest errors."""
    usual: Sequence
    """Sequence of the table if it contains joint angles, otherwise the one with the shortest motion."""
    is_given: bool
    work_map: WorkMap | None

    @property
    def reached(self) -> Array:
        """Poses (t, 4, 4) of the targets that have a posture."""
        return np.asarray(self.poses[np.unique(self.candidates.target)])

    @property
    def outside(self) -> int:
        """Number of targets whose posture in the best sequence lies outside the measured region."""
        covered = self.errors.covered
        if covered is None or self.knowledge == "typical":
            return 0
        return int((~covered[self.best.rows]).sum())

    @cached_property
    def played(self) -> Mask:
        """Mask (m, axes) of the joints with known backlash, whose side of approach matters."""
        moves = np.abs(self.errors.rising_mm - self.errors.falling_mm).max(axis=2, initial=0.0)
        return np.asarray((moves > 0) & (self.knowledge == "calibrated"))

    def ranked(self, rows: slice) -> list[int]:
        """Postures of a target in order of increasing expected error."""
        order = np.argsort(self.errors.expected_mm[rows], kind="stable")
        return [rows.start + k for k in order.tolist()]

    def to_dict(self) -> dict[str, Any]:
        rising, approached = self.errors.best_approach()
        targets: list[dict[str, Any]] = [
            {"target": k, "postures": [], "reason": self.candidates.reasons.get(k)} for k in range(len(self.poses))
        ]
        for target, rows in self.candidates.groups():
            targets[target]["postures"] = [self._posture(k, rising, approached) for k in self.ranked(rows)]
        return {
            "knowledge": self.knowledge,
            "verdict": self.verdict or None,
            "targets": targets,
            "sequence": self._sequence(self.best),
            "usual": {"given": self.is_given, **self._sequence(self.usual)},
            "outside_measured_region": self.outside,
            "map": self._map(),
        }

    def _posture(self, k: int, rising: Mask, approached: Array) -> dict[str, Any]:
        errors, axes, q = self.errors, len(self.rig.robot.axes), self.candidates.q[k]
        branch = int(self.candidates.branch[k])
        played = np.flatnonzero(self.played[k]).tolist()
        sides = {str(axis + 1): "rising" if rising[k, axis] else "falling" for axis in played}
        return {
            "q_deg": np.degrees(q[:axes]).tolist(),
            "rail_mm": float(RAIL_MM * q[axes]) if len(q) > axes else None,
            "branch": None if branch == NO_BRANCH else branch,
            "expected_mm": float(errors.expected_mm[k]),
            "error_mm": None if self.knowledge == "typical" else errors.error_mm[k].tolist(),
            "u_mm": float(errors.u_mm[k]),
            "play_mm": float(errors.play_mm[k]),
            "approach": sides,
            "approached_mm": float(approached[k]),
            "conditioning": float(self.candidates.conditioning[k]),
            "covered": None if errors.covered is None else bool(errors.covered[k]),
        }

    def _sequence(self, sequence: Sequence) -> dict[str, Any]:
        axes = len(self.rig.robot.axes)
        return {
            "targets": self.candidates.target[sequence.rows].tolist(),
            "q_deg": np.degrees(self.candidates.q[sequence.rows, :axes]).tolist(),
            "expected_mm": sequence.expected_mm.tolist(),
            "rms_mm": sequence.rms_mm if len(sequence.rows) else None,
            "changes": sequence.changes,
            "travel_deg": float(np.degrees(sequence.travel_rad)),
        }

    def _map(self) -> dict[str, Any] | None:
        if self.work_map is None:
            return None
        table = [[None if np.isnan(value) else value for value in row] for row in self.work_map.expected_mm.tolist()]
        return {
            "x_mm": self.work_map.x_mm.tolist(), "y_mm": self.work_map.y_mm.tolist(), "z_mm": self.work_map.z_mm,
            "part_mm": self.work_map.part_mm.tolist(), "expected_mm": table, "best_mm": self.work_map.best_mm,
        }  # fmt: skip


def choose_postures(
    rig: Rig, poses: Array, current: Array | None = None, *, change: float = CHANGE, part_mm: Array | None = None
) -> Postures:
    """Find and rank the postures at tool poses (n, 4, 4) in the world, in the order of a program.

    current: joint angles (n, axes) rad of the program so far, if it has them. change: price of a change of branch.
    part_mm (3,): size of a part to place in the work area.
    """
    arm = arm_of(rig.robot)
    rail = rig.robot.rail
    measured = pose_uncertainty(rig, supports(rig)).joints_rad
    # Whole turns stay near the middle of the existing program, of the measured range, or of the limits.
    near = np.asarray((arm.limits if measured is None else measured[: arm.axes]).mean(axis=1))
    if current is not None and len(current):
        near = np.asarray((current.min(axis=0) + current.max(axis=0))[: arm.axes] / 2)
    travel_m = None if rail is None else (rail.limits_mm[0] / RAIL_MM, rail.limits_mm[1] / RAIL_MM)
    candidates = _with_given(arm, poses, find_candidates(arm, poses, near, travel_m), current)
    taught = _taught(rig, candidates, measured)
    errors = expected_errors(rig, candidates.q, taught, solution=candidates.solution)
    best = best_sequence(candidates, errors, change=change)
    if current is None:
        usual = best_sequence(candidates, errors, change=1.0, travel=1.0, error=0.0)
    else:
        rows = [_row_of(candidates, current[target], target) for target, _ in candidates.groups()]
        usual = sequence_of(candidates, errors, np.array(rows, dtype=np.int64))
    placed = None
    reached = np.unique(candidates.target)
    if part_mm is not None and len(reached) and rail is None:
        middle = poses[reached[0]].copy()
        middle[:3, 3] = poses[reached, :3, 3].mean(axis=0)
        placed = work_map(rig, part_mm, middle, near, taught)
    return Postures(
        rig, poses, knowledge_of(rig), why_nothing(rig), candidates, errors, best, usual, current is not None, placed
    )  # fmt: skip


def _taught(rig: Rig, candidates: Candidates, measured: Array | None) -> Array:
    """Postures at which frame and tool are taught: over the measured region or, without one, all postures of the
    targets, which prefers none. Few postures would absorb their own errors: then over the joint ranges."""
    _, first = np.unique(candidates.solution, return_index=True)
    if measured is not None or len(first) < FEWEST_TAUGHT:
        return work_or_spread(rig, measured)
    return candidates.q[first]


def _with_given(arm: Arm, poses: Array, candidates: Candidates, current: Array | None) -> Candidates:
    """Add the postures of the program, which may be singular or absent from the samples."""
    if current is None:
        return candidates
    missing = [k for k in np.unique(candidates.target).tolist() if _row_of(candidates, current[k], k) is None]
    if not missing:
        return candidates
    q, target = current[missing], np.concatenate([candidates.target, missing])
    whole = Candidates(
        np.concatenate([candidates.q, q]),
        target,
        np.concatenate([candidates.solution, candidates.solution.max() + 1 + np.arange(len(missing))]),
        np.concatenate([candidates.branch, branch_of(arm, poses[missing], q)]),
        np.concatenate([candidates.conditioning, conditioning(arm, q)]),
        candidates.reasons,
    )
    return whole.of(np.argsort(target, kind="stable"))


def _row_of(candidates: Candidates, q: Array, target: int) -> int | None:
    """Row of the candidate at joint angles (axes,) rad; None if there is none."""
    rows = np.flatnonzero(candidates.target == target)
    if not len(rows):
        return None
    away = np.abs(candidates.q[rows] - q).max(axis=1)
    nearest = int(away.argmin())
    return int(rows[nearest]) if away[nearest] < _SAME_RAD else None
