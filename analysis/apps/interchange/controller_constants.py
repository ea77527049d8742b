"""Identification of the kinematic constants used by a controller from poses it computed.

A robot calibrated by the maker computes with individual constants. Typical controllers do not show these constants but
report the pose of the flange. Some 20 poses with joint angles determine the constants to the reported digits. This is
not a measurement: the constants are those assumed by the controller, and the real arm may differ.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.robot.description.rig_section import flange_poses, largest_difference, random_postures, robot_text
from analysis.robot.geometry.pose_setup import fit_constants, fit_setup
from analysis.robot.kinematics.arm import Array, arm_of, forward, without_setup
from rigs.arms import LibraryArm
from rigs.errors import FileError
from rigs.schema.robot import Robot

_LEFT_MM = 0.02
"""Largest residual of a fit. Controllers report places to 0.01 mm or better and joints to 0.001° (10 µm at 0.6 m);
more indicates a tool that is not removed.
"""
_SPARE = 10
"""Minimum number of redundant readings that confirm the constants."""
_DIGITS = 7


@dataclass(frozen=True)
class ControllerConstants:
    """A robot with the constants of the controller, as a section of a rig file, and a remark for the operator."""

    robot: Robot
    text: str
    words: str


def controller_constants(arm: LibraryArm, q: Array, xyz_mm: Array, R: Array | None, where: str) -> ControllerConstants:
    """Fit the constants of a library arm to flange poses computed by the controller.

    q: joint angles (n, axes) rad. xyz_mm: places (n, 3). R: orientations (n, 3, 3), if reported. Raises FileError if no
    constants fit.
    """
    bare = without_setup(arm_of(arm.robot))
    # The poses refer to the base of the arm, or to a base turned by 180° about z, such as base_link of ROS drivers.
    seen = fit_setup(forward(bare, q), xyz_mm).T_world_base[:3, :3]
    base = np.diag([-1.0, -1.0, 1.0]) if np.trace(seen[:2, :2]) < 0 else np.eye(3)
    fitted = fit_constants(bare, q, xyz_mm @ base, R if R is None else base @ R)
    if fitted.spare < _SPARE:
        raise FileError(
            where,
            f"has {len(q)} poses, too few for the constants of the arm",
            "give at least 20 in which all joints move",
        )
    if fitted.rms_mm > _LEFT_MM:
        problem = f"no link constants of {arm.name} match the flange poses: {fitted.rms_mm:.3g} mm rms remain"
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
