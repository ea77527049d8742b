"""Postures in which the poses of a table are reached.

A pose can be reached in up to eight postures, in which the arm has different errors. The user therefore states the
posture. Without a statement, a target is corrected only if its correction is the same in every posture.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from analysis.correction.corrected_targets import NotCorrected, corrected_angles
from analysis.correction.pose_uncertainty import frame_u_mm, pose_uncertainty
from analysis.correction.reasons import POSE_OF_UNKNOWN_CONTROLLER
from analysis.correction.support import Support
from analysis.correction.work import taught_angles, tool_places, used_effects
from analysis.robot.kinematics.arm import Arm, Array, Integers, controller_arm, forward
from analysis.robot.kinematics.inverse import NO_BRANCH, branch_of, inverse
from analysis.robot.kinematics.joint_limits import within_limits
from analysis.robot.kinematics.newton import conditioning
from rigs.errors import FileError, RigPlace, UseError
from rigs.rig import Rig
from rigs.text import numbers_in

Source = Literal["--near", "--start-joints", "rig_file"]
"""Origin of a stated posture. `--start-joints` is the posture at the start of the table, the others of every target."""
HOW_TO_STATE = "state the posture with --near and the joint angles at one of the targets, or give joint angles"
_MOST_TURNED_DEG = 1000.0
"""Maximum joint angle: arms turn less than three times."""
_LEAST_CONDITIONING = 0.01
"""Conditioning below which joint angles select no posture, because two postures meet there. Chosen: an angle of axis 5
below about 2°."""
_CLOSEST_RAD = np.radians(150.0)
"""Largest joint rotation to a closest solution that a controller certainly chooses. Chosen."""
_CLOSER = 1.5
"""Ratio of the distances of another solution and the closest one below which the choice is ambiguous. Chosen."""


@dataclass(frozen=True)
class StatedPosture:
    q: Array
    """Joint angles (6,) rad."""
    source: Source

    @property
    def degrees(self) -> list[float]:
        degrees: list[float] = np.degrees(self.q).round(6).tolist()
        return degrees

    @property
    def words(self) -> str:
        return ", ".join(f"{angle:z.4g}°" for angle in self.degrees)


@dataclass(frozen=True)
class TablePostures:
    """Postures of the n poses of a table."""

    q: Array
    """Joint angles (n, 6) rad of the controller; NaN without a solution."""
    unsolved: tuple[NotCorrected, ...]
    stated: StatedPosture | None = None
    several: Mapping[int, Array] = field(default_factory=dict)
    """Postures (k, 6) rad of the targets for which no statement selects one. The first of them is that in `q`."""

    def to_dict(self) -> dict[str, Any]:
        stated = self.stated
        return {
            "source": stated and stated.source, "joints_deg": stated and stated.degrees,
            "not_stated": len(self.several),
        }  # fmt: skip


def stated_posture(rig: Rig, near: str | None, start: str | None) -> StatedPosture | None:
    """The posture stated by an option, or else by the rig file.

    Raises UseError for two options, and for a text that is not a posture of the arm; FileError for the rig file.
    """
    if near is not None and start is not None:
        problem = "both state the posture"
        raise UseError("--near, --start-joints", problem, "give one of them", code="usage")
    if near is None and start is None:
        if rig.robot.posture_deg is None:
            return None
        stated = StatedPosture(np.radians(rig.robot.posture_deg), "rig_file")
        if problem := _problem(controller_arm(rig.robot), stated.q):
            where, remedy = RigPlace.of(rig.name, "robot.posture_deg"), "give the joint angles at one of the targets"
            raise FileError(where, problem, remedy, code="rig_file.invalid")
        return stated
    source: Source = "--start-joints" if near is None else "--near"
    text, axes = near or start or "", len(rig.robot.axes)
    degrees = numbers_in(text)
    if len(degrees) != axes or not all(abs(value) < _MOST_TURNED_DEG for value in degrees):
        problem = f"must be {axes} numbers, one for each joint" + f", but has {len(degrees)}" * bool(degrees)
        remedy = f"give q1,…,q{axes} in degrees"
        raise UseError(f"{source} {text}", problem, remedy, code="usage")
    if problem := _problem(controller_arm(rig.robot), np.radians(degrees)):
        remedy = "give the joint angles at one of the targets"
        raise UseError(f"{source} {text}", problem, remedy, code="usage")
    return StatedPosture(np.radians(degrees), source)


def _problem(arm: Arm, q: Array) -> str:
    """Why joint angles q (axes,) rad select no posture of an arm; empty if they do."""
    for axis in np.flatnonzero((q < arm.limits[:, 0] - 1e-9) | (q > arm.limits[:, 1] + 1e-9)).tolist():
        low, high = np.degrees(arm.limits[axis])
        return f"axis {axis + 1} at {np.degrees(q[axis]):g}° is beyond the limits {low:g}° and {high:g}°"
    is_singular = float(conditioning(arm, q[None])[0]) < _LEAST_CONDITIONING
    return "is at a singularity, where two postures meet, so it selects neither" if is_singular else ""


def find_postures(rig: Rig, poses: Array, stated: StatedPosture | None = None) -> TablePostures:
    """Solve the controller's angles of target poses (n, 4, 4) in the world, in the stated posture.

    The posture of every target is a configuration: the same sides of shoulder, elbow and wrist, in the closest turn.
    From a posture at the start, each target is reached in the closest solution, as long as that is unambiguous.
    """
    arm = controller_arm(rig.robot)
    q = np.full((len(poses), 6), np.nan)
    if rig.controller == "unknown":
        why = POSE_OF_UNKNOWN_CONTROLLER
        unsolved = tuple(NotCorrected(k, "controller_unknown", why) for k in range(len(poses)))
        return TablePostures(q, unsolved, stated)
    skipped, several = list[NotCorrected](), dict[int, Array]()
    is_configuration = stated is not None and stated.source != "--start-joints"
    near = _posture_of_tests(rig, arm) if stated is None else stated.q
    configuration = configuration_of(arm, near) if is_configuration else NO_BRANCH
    stands = None if stated is None else near
    for k, solutions in enumerate(solutions_within_limits(arm, poses)):
        if isinstance(solutions, str):
            skipped.append(NotCorrected(k, solutions, _WHY_NOT[solutions]))
            continue
        allowed = solutions.in_configuration(arm, poses[k], configuration)
        if not len(allowed.q):
            skipped.append(NotCorrected(k, "unreachable", "cannot be reached in the stated posture"))
            continue
        postures = allowed.postures(near)
        closest = closest_solution(allowed.q, stands) if stands is not None and len(postures) > 1 else None
        q[k] = postures[0] if closest is None else closest
        if closest is None and len(postures) > 1:
            several[k] = postures
        if not is_configuration:
            near = q[k]
            stands = None if stated is None or k in several else near
    return TablePostures(q, tuple(skipped), stated, several)


def configuration_of(arm: Arm, q: Array) -> int:
    """Configuration of a posture q (6,) rad; `NO_BRANCH` if the arm has no closed form."""
    return int(branch_of(arm, forward(arm, q[None]), q[None])[0])


Unreached = Literal["unreachable", "beyond_limits"]
_WHY_NOT: dict[Unreached, str] = {
    "unreachable": "is out of the nominal arm's reach",
    "beyond_limits": "can only be reached beyond a joint's limits",
}


def _posture_of_tests(rig: Rig, arm: Arm) -> Array:
    """Posture (6,) rad of the rig's tests, or the middle of the limits."""
    tests = [test for test in (rig.tests.hemisphere, rig.tests.circle) if test]
    near: Array = np.radians(tests[0].posture_deg) if tests else arm.limits.mean(axis=1)
    return near


@dataclass(frozen=True)
class PoseSolutions:
    """Solutions of a pose within the joint limits."""

    q: Array
    """Joint angles (m, 6) rad, including full turns."""
    branch: Integers
    """Number (m,) of the posture: equal for solutions that differ by full turns only."""

    def in_configuration(self, arm: Arm, pose: Array, configuration: int) -> PoseSolutions:
        """Those of a pose (4, 4) in a configuration; all if it is `NO_BRANCH`."""
        if configuration == NO_BRANCH:
            return self
        numbers, first = np.unique(self.branch, return_index=True)
        of_each = branch_of(arm, np.repeat(pose[None], len(first), axis=0), self.q[first])
        rows = np.isin(self.branch, numbers[of_each == configuration])
        return PoseSolutions(self.q[rows], self.branch[rows])

    def postures(self, near: Array) -> Array:
        """Of each posture the solution (k, 6) rad closest to `near`, the closest first."""
        order = np.argsort(np.abs(self.q - near).max(axis=1), kind="stable")
        _, first = np.unique(self.branch[order], return_index=True)
        postures: Array = self.q[order[np.sort(first)]]
        return postures


def solutions_within_limits(arm: Arm, poses: Array) -> list[PoseSolutions | Unreached]:
    """Solutions of each pose (n, 4, 4), or why there are none."""
    solutions = inverse(arm, poses)
    every: list[PoseSolutions | Unreached] = []
    for q, found in zip(solutions.q, solutions.found, strict=True):
        allowed = PoseSolutions(*within_limits(arm, np.where(found[:, None], q, np.nan)))
        every.append(allowed if len(allowed.q) else "beyond_limits" if found.any() else "unreachable")
    return every


def closest_solution(solutions: Array, stands: Array) -> Array | None:
    """The solution (6,) rad closest to angles (6,) rad by every measure; None if a controller may choose another."""
    turns = np.abs(solutions - stands)
    measures = np.array([turns.max(axis=1), turns.mean(axis=1), np.sqrt(np.mean(turns**2, axis=1))])
    best = int(measures[0].argmin())
    others = np.delete(measures, best, axis=1)
    if measures[0, best] > _CLOSEST_RAD or (others < _CLOSER * measures[:, [best]]).any():
        return None
    closest: Array = solutions[best]
    return closest


def disagreeing(
    rig: Rig, supported: Sequence[Support], postures: TablePostures, poses: Array
) -> tuple[NotCorrected, ...]:
    """Targets at poses (n, 4, 4) whose corrections in their several postures differ by more than u."""
    several = postures.several
    if not several:
        return ()
    rows, q = np.repeat([*several], [*map(len, several.values())]), np.concatenate([*several.values()])
    angles, solved, _ = corrected_angles(rig, supported, q, (), poses[rows])
    commanded = forward(controller_arm(rig.robot), angles)[:, :3, 3]
    error_mm = np.linalg.norm(tool_places(rig, used_effects(rig, supported), q) - poses[rows][:, :3, 3], axis=1)
    uncertainty = pose_uncertainty(rig, supported)
    first = np.array([of_target[0] for of_target in several.values()])
    u_mm = frame_u_mm(rig, uncertainty, first, taught_angles(rig, uncertainty.joints_rad))
    left = []
    for k, u in zip(several, u_mm.tolist(), strict=True):
        of_target = rows == k
        apart_mm = float(np.linalg.norm(commanded[of_target] - commanded[of_target][0], axis=1).max())
        if apart_mm > u or not solved[of_target].all():
            low, high = float(error_mm[of_target].min()), float(error_mm[of_target].max())
            count = int(of_target.sum())
            what = f"can be reached in {count} postures, in which its error is {low:.2f} to {high:.2f} mm"
            left.append(NotCorrected(k, "ambiguous", what, (low, high)))
    return tuple(left)
