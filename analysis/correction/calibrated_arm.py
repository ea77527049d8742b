"""The calibrated arm as a function: where its tool is at joint angles, and the angles at which it is at a pose.

Both are of the arm that stands: every effect that depends on the posture alone is in them, plays and what depends on
time are not. The uncertainty holds these, what the calibration leaves uncertain and what it does not explain.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from analysis.correction.corrected_targets import reached_angles
from analysis.correction.pose_uncertainty import (
    PoseUncertainty,
    covered,
    pose_uncertainty,
    position_u_mm,
    where_known,
)
from analysis.correction.support import supports
from analysis.correction.work import left_out_mm, tool_poses
from analysis.robot.kinematics.arm import Array, Mask, arm_of
from analysis.robot.kinematics.inverse import inverse
from analysis.robot.kinematics.joint_limits import within_limits
from analysis.robot.kinematics.newton import newton, newton_in_part, turned_rad
from analysis.robot.model.predict import Model, model_of
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.vocabulary import DRIVEN_AXES

_SEEDS = 128
"""Postures from which an arm without a list of branches is tried, beside the one near which it is asked for. Measured:
of 100 random postures of an FR3, an iiwa 14 and a WAM 128 reach all within the limits, 32 reach 99, 100 and 98, and 8
reach 70, 94 and 91; 65 to 165 ms a pose."""
_ORTHONORMAL = 1e-6
"""How far the rows of a rotation may be from unit vectors at right angles: rounding of ten digits, and no mistake."""
_ONE_FRAME = 2
"""Dimensions of a single frame (4, 4)."""
_UNTURNED_DEG, _UNTURNED_DIGITS, _ALIKE_DIGITS = 1e-6, 6, 3
"""Degrees below which a turn is rounding, and decimals of rad to which turns and postures are alike."""


@dataclass(frozen=True)
class ArmPoses:
    """Where the tool is. T (n, 4, 4): its poses in the world of the rig file, lengths in mm. u_mm (n,): the standard
    uncertainty of the place, all three coordinates together, NaN where the rig file says nothing of it, and where the
    posture is not covered (n,): a joint stands where the runs behind the model did not drive it, or the tool farther
    from what they touched than they judged the model; None where that is unknown."""

    T: Array
    u_mm: Array
    covered: Mask | None


@dataclass(frozen=True)
class ArmAngles:
    """Joint angles of poses. q_deg (n, axes): NaN where there are none within the limits. reached (n,): where there
    are. u_mm, covered: as of ArmPoses, at these angles. turned_deg (n,): by how much the tool is turned from what was
    asked, which an arm of fewer than six axes cannot always take; 0 with six."""

    q_deg: Array
    reached: Mask
    u_mm: Array
    covered: Mask | None
    turned_deg: Array


@dataclass(frozen=True)
class CalibratedArm:
    """The arm of a rig file with everything that was found of it, in its file and in its calibration."""

    rig: Rig

    def forward(self, q_deg: Array) -> ArmPoses:
        """Return the poses of the tool at joint angles q_deg (n, axes), or (axes,) of one posture, as the controller
        reports them; of an arm on a rail a column more, where it stands in m. Raises FileError for another number."""
        angles = _numbers(q_deg, "q_deg")
        angles = angles[None] if angles.ndim == 1 else angles
        widths = (self._axes, self._axes + 1) if self.rig.robot.rail else (self._axes,)
        if angles.ndim != 2 or angles.shape[1] not in widths or not np.isfinite(angles).all():
            problem = f"shape {angles.shape} is not that of finite joint angles (n, {widths[-1]})"
            raise FileError("q_deg", problem, "give a row for each posture")
        q = np.radians(angles)
        q[:, self._axes :] = angles[:, self._axes :]
        return ArmPoses(tool_poses(self._model, q), self._u_mm(q), covered(self._known, q))

    def inverse(self, T: Array, near_deg: Array | None = None) -> ArmAngles:
        """Return joint angles that put the tool of the calibrated arm at poses T (n, 4, 4), or (4, 4), lengths in mm.

        Of several postures the one nearest to near_deg (axes,) is taken, or the middle of the limits; each pose after
        the first is solved near the one before. Arms of seven axes keep as near to it as the pose allows. Those of
        fewer than six take the place, with the turn that is nearest to what was asked. Raises FileError for frames that
        are none.
        """
        poses = _numbers(T, "T")
        poses = poses[None] if poses.ndim == _ONE_FRAME else poses
        if poses.ndim != 3 or poses.shape[1:] != (4, 4) or not np.isfinite(poses).all():
            raise FileError("T", f"shape {poses.shape} is not that of finite frames (n, 4, 4)", "give a frame a pose")
        R = poses[:, :3, :3]
        off = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(initial=0.0)
        last_row_off = np.abs(poses[:, 3] - [0, 0, 0, 1]).max(initial=0.0)
        if off > _ORTHONORMAL or (np.linalg.det(R) < 0).any() or last_row_off > 0:
            problem = "holds a frame whose columns are not at right angles, right-handed and of length 1"
            raise FileError("T", problem, "give T[:, :3, :3] as rotations, T[:, :3, 3] in mm and T[:, 3] as 0 0 0 1")
        middle = arm_of(self.rig.robot).limits.mean(axis=1)
        start = middle if near_deg is None else np.radians(_numbers(near_deg, "near_deg"))
        if start.shape != middle.shape:
            raise FileError("near_deg", f"shape {start.shape} is not that of one posture", f"give {self._axes} angles")
        q, reached = np.full((len(poses), self._axes), np.nan), np.zeros(len(poses), dtype=bool)
        solved = self._solved if self._axes >= DRIVEN_AXES else self._solved_in_part
        for row, pose in enumerate(poses):
            if (angles := solved(pose, start)) is not None:
                q[row], reached[row], start = angles, True, angles
        u_mm, inside = np.full(len(poses), np.nan), covered(self._known, q)
        u_mm[reached] = self._u_mm(q[reached])
        turned = np.full(len(poses), np.nan)
        turned[reached] = np.degrees(turned_rad(tool_poses(self._model, q[reached]), poses[reached]))
        return ArmAngles(np.degrees(q), reached, u_mm, inside, np.where(turned < _UNTURNED_DEG, 0.0, turned))

    @cached_property
    def _model(self) -> Model:
        """The model with all effects that depend on the posture alone, as a URDF of it has their geometry."""
        whole = model_of(self.rig)
        return replace(whole, effects=tuple(effect for effect in whole.effects if effect.compensation().use != "none"))

    @cached_property
    def _known(self) -> PoseUncertainty:
        return pose_uncertainty(self.rig, supports(self.rig))

    @property
    def _axes(self) -> int:
        return len(self.rig.robot.axes)

    def _u_mm(self, q: Array) -> Array:
        """The standard uncertainty (n,) mm of the place at q (n, axes) rad; NaN where nothing was found of the arm."""
        if self.rig.calibrated is None and not any(effect.found for effect in self.rig.effects):
            return np.full(len(q), np.nan)
        uncorrected = [effect for effect in model_of(self.rig).effects if effect.compensation().use == "none"]
        stays = left_out_mm(self.rig, uncorrected, q)
        u_mm: Array = np.hypot(position_u_mm(self._known, q), np.linalg.norm(stays, axis=1))
        return where_known(self._known, q, u_mm)

    def _solved(self, pose: Array, near: Array) -> Array | None:
        """The angles (axes,) rad, near others, at which the tool of an arm of six or more axes is at a pose (4, 4)."""
        arm = self._model.arm
        # Postures (axes,) rad of the nominal arm from which to look for the pose, the nearest first.
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
        """Those of an arm of fewer axes at the place of a pose (4, 4), the least turned; of turns that are alike those
        near others."""
        starts = self._starts(near)
        nominal, solved = newton_in_part(self._model.arm, np.repeat(pose[None], len(starts), axis=0), starts)
        seeds = nominal[solved][np.unique(nominal[solved].round(_ALIKE_DIGITS), axis=0, return_index=True)[1]]
        poses = np.repeat(pose[None], len(seeds), axis=0)
        angles, solved = reached_angles(self._model, poses, seeds)
        kept = angles[[solved[k] and self._allowed(angles[k]) for k in range(len(angles))]]
        turned = turned_rad(tool_poses(self._model, kept), poses[: len(kept)]).round(_UNTURNED_DIGITS)
        order = np.lexsort((np.abs(kept - near).max(axis=1), turned))
        return np.asarray(kept[order[0]]) if len(kept) else None

    def _starts(self, near: Array) -> Array:
        """Postures (n, axes) rad from which a pose is looked for: those near which it is asked for, and drawn ones."""
        low, high = self._model.arm.limits.T
        return np.vstack([near, np.random.default_rng(0).uniform(low, high, (_SEEDS, self._axes))])

    def _allowed(self, q: Array) -> bool:
        """Whether joints q (axes,) rad stand within their limits, a rounding beyond them too."""
        limits = self._model.arm.limits
        return bool(((q >= limits[:, 0] - 1e-9) & (q <= limits[:, 1] + 1e-9)).all())


def _numbers(values: Array, name: str) -> Array:
    """Return an array of numbers. Raises FileError for what is none."""
    try:
        return np.array(values, dtype=float)
    except (TypeError, ValueError):
        raise FileError(name, "is no array of numbers", "give numbers, as numpy takes them") from None
