"""The calibrated arm: tool pose from joint angles, and joint angles from a tool pose.

Both refer to the real arm and include all effects that depend only on the posture. The stated uncertainty covers
backlash and time-dependent effects, the calibration, and the unexplained error.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from analysis.correction.corrected_targets import corrected, reached_angles
from analysis.correction.pose_uncertainty import PoseUncertainty, covered, places_u_mm, pose_uncertainty, where_known
from analysis.correction.support import supports, why_nothing
from analysis.correction.work import FEWEST_TAUGHT, left_out_mm, taught_angles, tool_poses
from analysis.robot.kinematics.arm import Array, Mask, arm_of
from analysis.robot.kinematics.inverse import inverse
from analysis.robot.kinematics.joint_limits import within_limits
from analysis.robot.kinematics.newton import newton, newton_in_part, turned_rad
from analysis.robot.predict import Model, model_of
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.vocabulary import DRIVEN_AXES

_SEEDS = 128
"""Number of start postures for an arm without closed-form branches, in addition to the given posture. Of 100 random
postures of an FR3, an iiwa 14 and a WAM, 128 starts reach all, 32 reach 98 or more. A pose takes 65 to 165 ms.
"""
_ORTHONORMAL = 1e-6
"""Permitted deviation of rotation rows from orthonormality: rounding to ten digits."""
_UNTURNED_DEG, _UNTURNED_DIGITS, _ALIKE_DIGITS = 1e-6, 6, 3
"""Rotation in degrees below which a result is a rounding error, and decimals in rad for equal rotations and
postures.
"""


@dataclass(frozen=True)
class ArmPoses:
    """Result of `CalibratedArm.forward`: tool poses with uncertainty."""

    T: Array
    """Poses (n, 4, 4) in the world of the rig file, lengths in mm."""
    u_mm: Array
    """Standard uncertainty (n,) of the position in the robot's base, all three coordinates together; NaN if
    unknown or not covered. It contains the place of the arm on its base, which touches and small tables hardly
    show.
    """
    covered: Mask | None
    """False (n,) if a joint is outside the range of the calibration runs, or the tool is further from the
    sockets than validated; None if unknown.
    """
    u_frame_mm: Array
    """The same as `u_mm` in a frame taught with the robot, which most programs use; often many times smaller.

    It is taught at these postures if the runs cover at least twelve of them, or else at those that were measured: for
    circles, over the range of their joints.
    """


@dataclass(frozen=True)
class ArmAngles:
    """Result of `CalibratedArm.inverse`: joint angles for poses."""

    q_deg: Array
    """Joint angles (n, axes); NaN if no solution lies within the limits."""
    reached: Mask
    """True (n,) for poses with a solution."""
    u_mm: Array
    """Standard uncertainties (n,) as in `ArmPoses`, as `u_frame_mm`."""
    covered: Mask | None
    turned_deg: Array
    """Rotation (n,) from the requested orientation: 0 for six or more axes; arms with fewer axes cannot reach
    every orientation.
    """
    u_frame_mm: Array
    near_deg: Array
    """Posture (n, axes) near which each pose is reached, as given or by default."""


@dataclass(frozen=True, repr=False)
class CalibratedArm:
    """Arm of a rig file with the errors known from the file and from its calibration. Create it with `calibrated_arm`.

    Example:

        arm = calibrated_arm("ur10e")
        wanted = arm.forward([0, -90, 90, 0, 90, 0]).T
        print(arm.inverse(wanted, near_deg=[0, -80, 80, 0, 90, 0]).q_deg)
    """

    rig: Rig

    def __repr__(self) -> str:
        return f"<arm of {self.rig.name}, {self._axes} axes, {'measured' if self._is_measured else 'not measured'}>"

    def forward(self, q_deg: Array) -> ArmPoses:
        """Return the tool poses at joint angles q_deg (n, axes), or (axes,) for a single posture, as reported by the
        controller.

        For an arm on a rail, an additional column contains the rail position in m. Raises FileError for other shapes.
        """
        angles = _numbers(q_deg, "q_deg")
        angles = angles[None] if angles.ndim == 1 else angles
        widths = (self._axes, self._axes + 1) if self.rig.robot.rail else (self._axes,)
        if angles.ndim != 2 or angles.shape[1] not in widths or not np.isfinite(angles).all():
            problem = f"must be finite joint angles (n, {widths[-1]}) in degrees, but has the shape {angles.shape}"
            raise FileError("q_deg", problem, "give one row per posture", code="argument.invalid")
        q = np.radians(angles)
        q[:, self._axes :] = angles[:, self._axes :]
        u_mm, u_frame_mm = self._u_mm(q)
        return ArmPoses(tool_poses(self._model, q), u_mm, covered(self._pose_uncertainty, q), u_frame_mm)

    def inverse(self, T: Array, near_deg: Array | None = None) -> ArmAngles:
        """Return joint angles that move the tool of the calibrated arm to poses T (n, 4, 4), or (4, 4), lengths in mm.

        If several postures reach a pose, the one nearest to near_deg (axes,) is selected, by default to
        `posture_deg` of the robot in the rig file, or else to the middle of the limits. Each further pose is solved
        near the previous solution. The angles are right in this posture only: send them, not the pose. Arms of seven
        axes stay as near to it as the pose allows. Arms of fewer than six axes reach the position with the closest
        possible orientation. Raises FileError for invalid frames.
        """
        poses = _frames(T, "T")
        middle = arm_of(self.rig.robot).limits.mean(axis=1)
        of_rig = middle if self.rig.robot.posture_deg is None else np.radians(self.rig.robot.posture_deg)
        start = of_rig if near_deg is None else np.radians(_numbers(near_deg, "near_deg"))
        if start.shape != middle.shape:
            raise FileError(
                "near_deg",
                f"must be a single posture, but has the shape {start.shape}",
                f"give {self._axes} angles",
                code="argument.invalid",
            )
        return self._inverse(poses, start)

    def _inverse(self, poses: Array, start: Array) -> ArmAngles:
        """start: posture (axes,) rad near the first pose, each other pose near the previous one; or (n, axes) near
        each."""
        near = np.broadcast_to(start, (len(poses), self._axes)).copy()
        q, reached = np.full(near.shape, np.nan), np.zeros(len(poses), dtype=bool)
        solved = self._solved if self._axes >= DRIVEN_AXES else self._solved_in_part
        for row, pose in enumerate(poses):
            if (angles := solved(pose, near[row])) is not None:
                q[row], reached[row] = angles, True
                if start.ndim == 1:
                    near[row + 1 :] = angles
        u_mm, inside = np.full((2, len(poses)), np.nan), covered(self._pose_uncertainty, q)
        u_mm[:, reached] = self._u_mm(q[reached])
        turned = np.full(len(poses), np.nan)
        turned[reached] = np.degrees(turned_rad(tool_poses(self._model, q[reached]), poses[reached]))
        turned = np.where(turned < _UNTURNED_DEG, 0.0, turned)
        return ArmAngles(np.degrees(q), reached, u_mm[0], inside, turned, u_mm[1], np.degrees(near))

    def correct(self, targets: Array, near: Array | None = None) -> ArmAngles:
        """Return joint angles to command so that the real tool reaches targets of the nominal arm.

        targets: joint angles (n, axes), or (axes,), in degrees, as a program commands them, or tool poses (n, 4, 4), or
        (4, 4), in mm. near: for poses the postures (n, axes) in degrees to stay near, or one as in `inverse`.
        Targets that cannot be corrected are NaN, and False in `reached`. Raises FileError if the arm was not measured
        or the model must not be used for a correction.
        """
        if not self._is_measured:
            problem = "was not measured: the rig has neither a calibration nor effects, so no target would change"
            remedy = "give the rig file written by diagnose(…).save(directory) or rig diagnose -o"
            raise FileError(self.rig.name, problem, remedy, code="calibration.missing")
        if why := why_nothing(self.rig):
            raise FileError(
                self.rig.name, why, "measure what `acts` of the diagnosis ask for", code="calibration.missing"
            )
        given = _numbers(targets, "targets")
        # Four targets of an arm with four axes have the shape of a frame.
        if given.shape[-2:] == (4, 4) and (self._axes != 4 or given.ndim == 3 or (given[3] == [0, 0, 0, 1]).all()):
            return self._correct_poses(given, near)
        if near is not None:
            problem = "is for tool poses, and the targets are joint angles"
            raise FileError("near", problem, "leave `near` out", code="argument.invalid")
        q = given[None] if given.ndim == 1 else given
        if q.ndim != 2 or q.shape[1] != self._axes or not np.isfinite(q).all():
            problem = f"must be angles (n, {self._axes}) in degrees or poses (n, 4, 4), but has the shape {given.shape}"
            raise FileError("targets", problem, "give one row or one frame per target", code="argument.invalid")
        found = corrected(self.rig, supports(self.rig), np.radians(q))
        angles = np.where(found.done[:, None], np.degrees(found.q), np.nan)
        turned = np.where(found.done, 0.0, np.nan)
        return ArmAngles(angles, found.done, found.u_mm, found.covered, turned, found.u_frame_mm, q)

    def _correct_poses(self, T: Array, near: Array | None) -> ArmAngles:
        """Angles for poses, each near its own posture if several are given."""
        postures = None if near is None else _numbers(near, "near")
        if postures is None or postures.ndim == 1:
            return self.inverse(T, postures)
        poses = _frames(T, "targets")
        if postures.shape != (len(poses), self._axes) or not np.isfinite(postures).all():
            problem = f"must have a row of {self._axes} angles per pose, but has the shape {postures.shape}"
            raise FileError("near", problem, "give one posture, or one per pose", code="argument.invalid")
        return self._inverse(poses, np.radians(postures))

    @property
    def _is_measured(self) -> bool:
        return self.rig.calibrated is not None or bool(self.rig.effects)

    @cached_property
    def _model(self) -> Model:
        """The model with all posture-dependent effects; the exported URDF contains the geometric part."""
        whole = model_of(self.rig)
        return replace(whole, effects=tuple(effect for effect in whole.effects if effect.compensation().use != "none"))

    @cached_property
    def _pose_uncertainty(self) -> PoseUncertainty:
        return pose_uncertainty(self.rig, supports(self.rig))

    @property
    def _axes(self) -> int:
        return len(self.rig.robot.axes)

    def _u_mm(self, q: Array) -> Array:
        """Standard uncertainties (2, n) mm of the position, in the base and in a taught frame; NaN for an unmeasured
        arm.
        """
        is_measured = self.rig.calibrated is not None or any(effect.found for effect in self.rig.effects)
        if not is_measured or not len(q):
            return np.full((2, len(q)), np.nan)
        uncorrected = [effect for effect in model_of(self.rig).effects if effect.compensation().use == "none"]
        stays = left_out_mm(self.rig, uncorrected, q)
        inside = covered(self._pose_uncertainty, q)
        taught = q if inside is None else q[inside]
        if len(taught) < FEWEST_TAUGHT:
            taught = taught_angles(self.rig, self._pose_uncertainty.joints_rad)[:, : q.shape[1]]
        both = places_u_mm(self.rig, self._pose_uncertainty, q, taught)
        left_mm = np.linalg.norm(stays, axis=1)
        return np.array([where_known(self._pose_uncertainty, q, np.hypot(u_mm, left_mm)) for u_mm in both])

    def _solved(self, pose: Array, near: Array) -> Array | None:
        """Angles (axes,) rad, closest to `near`, that put the tool of an arm of six or more axes at a pose (4, 4)."""
        arm = self._model.arm
        # start postures (axes,) rad of the nominal arm, the closest first
        if self._axes == DRIVEN_AXES:
            solutions = inverse(arm, pose[None])
            branches = solutions.q[0][solutions.found[0]]
            allowed = within_limits(arm, branches)[0] if len(branches) else branches
            seeds = sorted(allowed, key=lambda q: float(np.abs(q - near).max())) or [near]
        else:
            starts = self._starts(near)
            nominal, solved = newton(arm, np.repeat(pose[None], len(starts), axis=0), starts)
            seeds = [q for q, is_there in zip(nominal, solved, strict=True) if is_there and self._allowed(q)]
        for seed in seeds:
            angles, reached = reached_angles(self._model, pose[None], seed[None])
            if reached[0] and self._allowed(angles[0]):
                return np.asarray(angles[0])
        return None

    def _solved_in_part(self, pose: Array, near: Array) -> Array | None:
        """Angles of an arm with fewer than six axes that reach the position of a pose (4, 4), with the smallest
        rotation from it; among equal rotations, closest to `near`.
        """
        starts = self._starts(near)
        nominal, solved = newton_in_part(self._model.arm, np.repeat(pose[None], len(starts), axis=0), starts)
        seeds = nominal[solved][np.unique(nominal[solved].round(_ALIKE_DIGITS), axis=0, return_index=True)[1]]
        poses = np.repeat(pose[None], len(seeds), axis=0)
        angles, solved = reached_angles(self._model, poses, seeds)
        kept = angles[[solved[k] and self._allowed(angles[k]) for k in range(len(angles))]]
        turned = turned_rad(tool_poses(self._model, kept), poses[: len(kept)]).round(_UNTURNED_DIGITS)
        order = np.lexsort((np.abs(kept - near).max(axis=1), turned))
        return kept[order[0]] if len(kept) else None

    def _starts(self, near: Array) -> Array:
        low, high = self._model.arm.limits.T
        return np.vstack([near, np.random.default_rng(0).uniform(low, high, (_SEEDS, self._axes))])

    def _allowed(self, q: Array) -> bool:
        limits = self._model.arm.limits
        return bool(((q >= limits[:, 0] - 1e-9) & (q <= limits[:, 1] + 1e-9)).all())


def _frames(values: Array, name: str) -> Array:
    """Poses (n, 4, 4) of a user. Raises FileError for others."""
    poses = _numbers(values, name)
    poses = poses[None] if poses.shape == (4, 4) else poses
    if poses.ndim != 3 or poses.shape[1:] != (4, 4) or not np.isfinite(poses).all():
        problem = f"must be finite frames (n, 4, 4), but has the shape {poses.shape}"
        raise FileError(name, problem, "give one frame per pose", code="argument.invalid")
    R = poses[:, :3, :3]
    off = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(initial=0.0)
    last_row_off = np.abs(poses[:, 3] - [0, 0, 0, 1]).max(initial=0.0)
    if off > _ORTHONORMAL or (np.linalg.det(R) < 0).any() or last_row_off > 0:
        problem = "contains a frame that is not orthonormal and right-handed"
        remedy = f"give {name}[:, :3, :3] as rotations, {name}[:, :3, 3] in mm and {name}[:, 3] as 0 0 0 1"
        raise FileError(name, problem, remedy, code="argument.invalid")
    return poses


def _numbers(values: Array, name: str) -> Array:
    try:
        return np.array(values, dtype=float)
    except (TypeError, ValueError):
        raise FileError(
            name, "is not an array of numbers", "give numbers or a numpy array", code="argument.invalid"
        ) from None
