"""Comparison of two arms of the same model: the distance between their tools at equal joint angles.

It shows whether a program can be moved from one arm to the other. The complete difference refers to the robot bases.
The remaining difference applies if frame and tool are taught for each arm.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from analysis.apps.interchange.exported_arm import joint_traits
from analysis.correction.calibrated_arm import CalibratedArm
from analysis.correction.work import rest_mm
from analysis.robot.kinematics.arm import Array, pose_error
from analysis.robot.model.predict import geometric_arm, model_of
from analysis.runs.noise.readings import rms
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.robot import Pose

_POSTURES = 200
"""Number of postures. Chosen: it determines an rms to 5 %."""
_OTHER_MODEL_MM = 20.0
"""Smallest difference in mm that indicates a different model. Arms of the same model, calibrated or not, agree
within some mm.
"""
_CONSTANTS = (("zero_deg", "offset"), ("a_mm", "a"), ("d_mm", "d"), ("alpha_deg", "alpha"), ("beta_deg", "beta"))


@dataclass(frozen=True)
class ArmsApart:
    """Tool of `other` minus tool of `rig` in the bases of the arms, with the tool of `rig` on both.

    q_deg (n, axes): postures within the limits of both arms, and within the joint angles of their runs if known.
    apart_mm (n, 3), turned_deg (n,): differences of position and orientation. taught_mm (n,): remaining position
    difference with frame and tool taught. u_mm (n,): standard uncertainty of the difference, NaN if unknown for an arm.
    constants: differing constants by axis. doubts: as text.
    """

    names: tuple[str, str]
    q_deg: Array
    apart_mm: Array
    turned_deg: Array
    taught_mm: Array
    u_mm: Array
    constants: tuple[dict[str, float], ...]
    play_deg: tuple[dict[int, float], dict[int, float]]
    doubts: tuple[str, ...]

    @property
    def distance_mm(self) -> Array:
        """Distance between the tools (n,) mm."""
        distance: Array = np.linalg.norm(self.apart_mm, axis=1)
        return distance

    def to_dict(self) -> dict[str, Any]:
        """Return plain types, None for unknown values."""
        return {
            "arms": list(self.names),
            "rms_mm": rms(self.distance_mm),
            "max_mm": float(self.distance_mm.max()),
            "taught_rms_mm": rms(self.taught_mm),
            "turned_rms_deg": rms(self.turned_deg),
            "u_rms_mm": None if np.isnan(self.u_mm).any() else rms(self.u_mm),
            "constants": [dict(of_axis) for of_axis in self.constants],
            "play_deg": [{str(axis): width for axis, width in of_arm.items()} for of_arm in self.play_deg],
            "doubts": list(self.doubts),
            "poses": [
                {
                    "q_deg": q,
                    "apart_mm": apart,
                    "turned_deg": turned,
                    "taught_mm": taught,
                    "u_mm": None if np.isnan(u) else float(u),
                }
                for q, apart, turned, taught, u in zip(
                    self.q_deg.tolist(),
                    self.apart_mm.tolist(),
                    self.turned_deg.tolist(),
                    self.taught_mm.tolist(),
                    self.u_mm,
                    strict=True,
                )
            ],
        }


def arms_apart(rig: Rig, second: Rig) -> ArmsApart:
    """Return the difference between two arms of the same model. Raises FileError for different models."""

    def mounted(robot_of: Rig) -> CalibratedArm:
        """Return an arm at the origin with the tool of the first arm, to compare both relative to their bases."""
        bare = {"base": Pose(), "tool": rig.robot.tool, "rail": None}
        robot = robot_of.robot.model_copy(update=bare)
        return CalibratedArm(robot_of.model_copy(update={"robot": robot}))

    arms = mounted(rig), mounted(second)
    q_deg = _postures(*arms)
    nominal = [CalibratedArm(arm.rig.model_copy(update={"effects": (), "calibrated": None})) for arm in arms]
    places = [arm.forward(q_deg).T[:, :3, 3] for arm in nominal]
    if rms(np.linalg.norm(places[1] - places[0], axis=1)) > _OTHER_MODEL_MM:
        problem = f"the arm has a different build than that of {rig.name}: {second.robot.name}, not {rig.robot.name}"
        raise FileError(
            second.name,
            problem,
            "compare arms of the same model, or add RUN… to compare both with runs",
            code="compare.other_model",
        )
    stands = [arm.forward(q_deg) for arm in arms]
    difference, u_mm = pose_error(stands[0].T, stands[1].T), np.hypot(stands[0].u_mm, stands[1].u_mm)
    doubts = [
        f"{arm.rig.name} has neither effects nor calibration: rig compares the nominal arm"
        for arm in arms
        if not model_of(arm.rig).effects
    ]
    if not doubts and (unknown := int(np.isnan(u_mm).sum())):
        doubts.append(f"no u: at {unknown} of {len(u_mm)} postures the uncertainty of both arms is unknown")
    return ArmsApart(
        (rig.name, second.name),
        q_deg,
        difference[:, :3],
        np.degrees(np.linalg.norm(difference[:, 3:], axis=1)),
        rest_mm(stands[1].T[:, :3, 3], stands[0].T),
        u_mm,
        _constants(arms[0].rig, arms[1].rig),
        (dict(joint_traits(rig).play_deg), dict(joint_traits(second).play_deg)),
        tuple(doubts),
    )


def _postures(*arms: CalibratedArm) -> Array:
    """Return postures (n, axes) in degrees possible for all arms. Raises FileError if none exist."""
    robots = [arm.rig.robot for arm in arms]
    if len({len(robot.axes) for robot in robots}) > 1:
        problem = f"the arm has {len(robots[1].axes)} axes, that of {arms[0].rig.name} has {len(robots[0].axes)}"
        raise FileError(arms[1].rig.name, problem, "compare arms of the same model", code="compare.other_model")
    ranges = [[axis.limits_deg for axis in robot.axes] for robot in robots]
    ranges += [list(arm.rig.calibrated.joints_deg) for arm in arms if arm.rig.calibrated]
    low, high = np.array(ranges)[:, :, 0].max(axis=0), np.array(ranges)[:, :, 1].min(axis=0)
    if (low > high).any():
        axis = int(np.flatnonzero(low > high)[0]) + 1
        problem = f"the two arms share no angle of axis {axis}, according to the limits and the calibration runs"
        raise FileError(
            arms[1].rig.name, problem, "calibrate both over the same angles", code="compare.no_common_range"
        )
    return np.asarray(np.random.default_rng(0).uniform(low, high, (_POSTURES, len(low))))


def _constants(*rigs: Rig) -> tuple[dict[str, float], ...]:
    """Return the differences of the constants by axis, second arm minus first: angles in degrees, lengths in mm."""
    arms = [geometric_arm(model_of(rig)) for rig in rigs]
    by_axis = []
    for axis in range(arms[0].axes):
        differences = {
            name: float(getattr(arms[1], key)[axis] - getattr(arms[0], key)[axis]) for name, key in _CONSTANTS
        }
        by_axis.append(
            {name: np.degrees(value) if name.endswith("deg") else value for name, value in differences.items()}
        )
    return tuple(by_axis)
