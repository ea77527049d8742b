"""Postures of a program: all that reach each target, their best sequence, and the best place of a part."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from analysis.apps.postures.candidates import LEAST_CONDITIONING, NO_BRANCH, Candidates, branch_of, find_candidates
from analysis.apps.postures.expected_error import Knowledge, PostureErrors, expected_errors, knowledge_of
from analysis.correction.pose_uncertainty import pose_uncertainty
from analysis.correction.support import supports, why_nothing
from analysis.correction.work import FEWEST_TAUGHT, spread_angles
from analysis.robot.kinematics.arm import RAIL_MM, Arm, Array, Integers, Mask, arm_of
from analysis.robot.kinematics.newton import conditioning
from rigs.rig import Rig

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
_SAME_RAD = np.radians(0.5)
"""Largest difference between a candidate and the posture in a table of joint angles."""


@dataclass(frozen=True)
class Postures:
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
    taught = _taught_postures(rig, candidates, measured)
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


def _taught_postures(rig: Rig, candidates: Candidates, measured: Array | None) -> Array:
    """Postures at which frame and tool are taught: over the measured region or, without one, all postures of the
    targets, which prefers none. Few postures would absorb their own errors: then around the rig's work area.
    """
    _, first = np.unique(candidates.solution, return_index=True)
    if measured is not None or len(first) < FEWEST_TAUGHT:
        return spread_angles(rig, measured)
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
    rows = np.flatnonzero(candidates.target == target)
    if not len(rows):
        return None
    away = np.abs(candidates.q[rows] - q).max(axis=1)
    nearest = int(away.argmin())
    return int(rows[nearest]) if away[nearest] < _SAME_RAD else None


# ----------------------------------------------------------------------------------------------------------------------
# Map of the work area: the expected error of a part at each possible place.
#
# The nodes of a horizontal grid are reached with a fixed orientation of the tool. A part covers several nodes and is
# processed in one branch, so its error is the rms over its nodes in the best branch.

_NODES = 21
"""Nodes along each side of the map. Chosen: one every 130 mm for an arm with a reach of 1.3 m."""


@dataclass(frozen=True)
class WorkMap:
    """Expected error of a part by the place of its centre in the world."""

    x_mm: Array
    y_mm: Array
    z_mm: float
    part_mm: Array
    expected_mm: Array
    """Rms error (y, x), NaN where the part cannot be processed."""

    @property
    def best_mm(self) -> tuple[float, float] | None:
        """Centre x, y of the best place; None if the part fits nowhere."""
        if not np.isfinite(self.expected_mm).any():
            return None
        row, column = np.unravel_index(int(np.nanargmin(self.expected_mm)), self.expected_mm.shape)
        return float(self.x_mm[column]), float(self.y_mm[row])

    def at(self, x_mm: float, y_mm: float) -> float:
        """Expected error in mm at the node nearest to a place, NaN if there is none."""
        column, row = int(np.abs(self.x_mm - x_mm).argmin()), int(np.abs(self.y_mm - y_mm).argmin())
        step = self.x_mm[1] - self.x_mm[0]
        near = abs(self.x_mm[column] - x_mm) <= step and abs(self.y_mm[row] - y_mm) <= step
        return float(self.expected_mm[row, column]) if near else float("nan")


def work_map(rig: Rig, part_mm: Array, pose: Array, near: Array, taught: Array | None = None) -> WorkMap:
    """Map a part (3,) mm processed with the orientation and at the height of a tool pose (4, 4).

    near: reference posture (axes,) rad for full turns. taught: postures at which frame and tool are taught.
    """
    arm = arm_of(rig.robot)
    # An upper bound of the distance of the tool from axis 1
    reach = float(np.hypot(arm.a, arm.d)[1:].sum() + np.linalg.norm(arm.T_flange_tool[:3, 3]))
    step = 2 * reach / (_NODES - 1)
    side = np.linspace(-reach, reach, _NODES)
    x_mm, y_mm = arm.T_world_base[0, 3] + side, arm.T_world_base[1, 3] + side
    heights = np.unique(pose[2, 3] + np.array([-0.5, 0.5]) * part_mm[2])
    layers = [_node_errors(rig, np.stack(np.meshgrid(x_mm, y_mm), axis=-1), z, pose, near, taught) for z in heights]
    square = np.stack(layers)
    half = [max(0, round(size / 2 / step)) for size in part_mm[:2]]
    return WorkMap(x_mm, y_mm, float(pose[2, 3]), part_mm, np.sqrt(_of_parts(square, half[0], half[1])))


def _node_errors(rig: Rig, xy: Array, z: float, pose: Array, near: Array, taught: Array | None) -> Array:
    """Square of the expected error (y, x, branch) mm² at nodes xy (y, x, 2) mm, infinite out of reach."""
    nodes = xy.reshape(-1, 2)
    poses = np.tile(pose, (len(nodes), 1, 1))
    poses[:, :2, 3], poses[:, 2, 3] = nodes, z
    candidates = _nearest_turns(find_candidates(arm_of(rig.robot), poses, near), near)
    expected = expected_errors(rig, candidates.q, taught).expected_mm if len(candidates.q) else np.zeros(0)
    square = np.full((len(nodes), 8), np.inf)
    np.minimum.at(square, (candidates.target, np.maximum(candidates.branch, 0)), expected**2)
    return square.reshape(*xy.shape[:2], 8)


def _nearest_turns(candidates: Candidates, near: Array) -> Candidates:
    """A single posture of each solution, with the turns nearest to a reference posture."""
    away = np.abs(candidates.q[:, : len(near)] - near).max(axis=1)
    order = np.lexsort((away, candidates.solution))
    _, first = np.unique(candidates.solution[order], return_index=True)
    return candidates.of(np.sort(order[first]))


def _of_parts(square: Array, half_x: int, half_y: int) -> Array:
    """Mean square error (y, x) of parts that extend over half_x and half_y nodes to each side, in the best branch.

    square: (layer, y, x, branch).
    """
    padding = ((half_y, half_y), (half_x, half_x), (0, 0))
    padded = np.pad(square.mean(axis=0), padding, constant_values=np.inf)
    windows = np.lib.stride_tricks.sliding_window_view(padded, (2 * half_y + 1, 2 * half_x + 1), axis=(0, 1))
    best = windows.mean(axis=(3, 4)).min(axis=2)
    return np.where(np.isfinite(best), best, np.nan)


# ----------------------------------------------------------------------------------------------------------------------
# Best sequence along a program: small errors, few changes of branch, short joint travel.
#
# Each joint approaches from the previous posture, so the sign of its backlash is known.


@dataclass(frozen=True)
class Sequence:
    rows: Integers
    expected_mm: Array
    """Expected error (t,), with the side of approach given by the program."""
    changes: int
    travel_rad: float
    """Sum over all moves of the largest joint motion."""

    @property
    def rms_mm(self) -> float:
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
        approached = _approached_errors(repeated, away.reshape(-1, away.shape[2])).reshape(len(away), -1)
        price = error * approached / unit + travel * moves
        price += singular[rows] + change * _branch_changes(
            candidates.branch[before, None], candidates.branch[None, rows]
        )
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
    expected[1:] = _approached_errors(errors.of(rows[1:]), away)
    return Sequence(
        rows, expected, int(_branch_changes(branch[:-1], branch[1:]).sum()), float(np.abs(away).max(axis=1).sum())
    )


def _branch_changes(before: Integers, after: Integers) -> Mask:
    return np.asarray((before != after) & (before != NO_BRANCH) & (after != NO_BRANCH))


def _approached_errors(errors: PostureErrors, away: Array) -> Array:
    """Expected errors (m,) mm after motions (m, axes) rad; the side of a joint at rest is unknown."""
    moved = away[:, : errors.rising_mm.shape[1]]
    return errors.from_sides(np.where(np.abs(moved) > _STAYS_RAD, np.sign(moved), 0.0))
