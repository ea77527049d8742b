"""The constants by which a controller computes the place of its flange, read out of poses that it computed.

A robot that its maker calibrated computes with constants of its own. Many controllers do not show them, but each states
the pose of its flange: some 20 poses and their joints hold them, to the digits that are stated. This is no measurement:
it says what the controller believes, and nothing of where the arm is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.robot.description.rig_section import flange_poses, largest_difference, random_postures, robot_text
from analysis.robot.geometry.pose_setup import fit_constants, fit_setup
from analysis.robot.kinematics.arm import Array, arm_of, forward, without_setup
from rigs.arms import Arm
from rigs.errors import FileError
from rigs.schema.robot import Robot

_LEFT_MM = 0.02
"""Controllers state places to 0.01 mm or better and joints to 0.001° (10 µm at 0.6 m); more is another tool."""
_SPARE = 10
"""Readings beyond the constants that must confirm them."""
_DIGITS = 7


@dataclass(frozen=True)
class ControllerConstants:
    """A robot with its controller's constants, as a section, and what a person should know of them."""

    robot: Robot
    text: str
    words: str


def controller_constants(arm: Arm, q: Array, xyz_mm: Array, R: Array | None, where: str) -> ControllerConstants:
    """Return an arm of the library with the constants by which its controller put the flange at places xyz_mm (n, 3),
    turned as R (n, 3, 3) where stated, at joints q (n, axes) rad. Raises FileError where no constants do."""
    bare = without_setup(arm_of(arm.robot))
    # The frame of the poses is the arm's base, or that turned half round about z, as base_link of ROS drivers is.
    seen = fit_setup(forward(bare, q), xyz_mm).T_world_base[:3, :3]
    base = np.diag([-1.0, -1.0, 1.0]) if np.trace(seen[:2, :2]) < 0 else np.eye(3)
    fitted = fit_constants(bare, q, xyz_mm @ base, R if R is None else base @ R)
    if fitted.spare < _SPARE:
        raise FileError(where, f"has {len(q)} poses, too few for the constants of the arm", "give 20, all joints moved")
    if fitted.rms_mm > _LEFT_MM:
        problem = f"no constants of {arm.name} put the flange there: {fitted.rms_mm:.3g} mm remain"
        raise FileError(where, problem, "set the tool of the controller to none, and give flange poses and joints")
    axes = tuple(
        axis.model_copy(
            update={
                "a_mm": _written(fitted.arm.a[k]), "d_mm": _written(fitted.arm.d[k]),
                "alpha_deg": _written(np.degrees(fitted.arm.alpha[k])),
                "beta_deg": _written(np.degrees(fitted.arm.beta[k])),
                "offset_deg": _written(np.degrees(fitted.arm.offset[k])),
            }
        )
        for k, axis in enumerate(arm.robot.axes)
    )  # fmt: skip
    robot = arm.robot.model_copy(update={"name": f"{arm.robot.name}, as computed by the controller", "axes": axes})
    postures = random_postures(arm.robot)
    moved_mm, _ = largest_difference(flange_poses(robot, postures), flange_poses(arm.robot, postures))
    head = f"# {arm.maker} {arm.model} with the constants of the controller, read from {len(q)} poses of it\n"
    words = (
        f"{where}: the controller's own constants, to {1e3 * fitted.rms_mm:.2g} µm; they move the flange by up to "
        f"{moved_mm:.3f} mm, and do not show the true position: this needs an instrument"
    )
    return ControllerConstants(robot, head + robot_text(robot), words)


def _written(value: float) -> float:
    return float(np.round(value, _DIGITS)) + 0.0
