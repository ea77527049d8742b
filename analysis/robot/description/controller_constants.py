"""Constants with which a controller computes, from poses that it computed.

A robot measured by its maker computes with individual constants. Where the controller does not show them, the joint
angles and the flange pose do: one such pair tells whether the constants are those of the data sheet, and some twenty
determine them to the reported digits. This is not a measurement: the real arm may differ.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.robot.description.rig_section import flange_poses, largest_difference, random_postures
from analysis.robot.geometry.pose_setup import fit_constants, fit_setup, undetermined_mm
from analysis.robot.kinematics.arm import Arm, Array, arm_of, forward
from rigs.arms import load_arm
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.controllers import practice_of
from rigs.schema.robot import ConstantsSource, ControllerArm, JointAxis, LengthUnit, LinkConstants, Pose, Robot

_RESIDUAL_MM = 0.02
"""Largest residual of a fit. Controllers report places to 0.01 mm or better and joints to 0.001° (10 µm at 0.6 m);
more indicates a tool that is not removed.
"""
_UNDETERMINED_MM = 0.1
"""Largest displacement of the flange by a change of 1 mm that the poses do not show. Constants differ by up to 1 mm, so
the controller is then known to 0.1 mm.
"""
_PROVES = 5
"""Poses that prove a data sheet where the maker measures each robot. One of thirty single poses of such arms agrees
with it within the digits of a pendant.
"""
_SPARE = 10
"""Minimum number of redundant readings that confirm the constants."""
_DIGITS = 7
_SAME_MM = 1e-3
"""Distance of the flange below which two sets of constants are equal: the digits of files and rig files differ."""
MOST_ZERO_DEG = 0.5
"""Wrong joint zero that a correction may compensate. A larger error means that the arm must be mastered, or that the
rig file is wrong.
"""
_MOST_DECIMALS = 6


@dataclass(frozen=True)
class ControllerConstants:
    """Axes of an arm as the controller has them.

    arm: data_sheet if they agree with the data sheet within the digits of the source, constants otherwise. moved_mm:
    largest displacement of the flange from the data sheet. words: remark for the user. notes: facts to check.
    """

    axes: tuple[JointAxis, ...]
    arm: ControllerArm
    moved_mm: float
    words: str
    notes: tuple[str, ...] = ()
    source: ConstantsSource | None = None
    """The file, for constants read from one."""
    linear_units: LengthUnit | None = None
    """Unit of the lengths in the controller, if the file states it."""


def constants_in(robot: Robot) -> tuple[LinkConstants, ...]:
    """Constants of the controller in a rig file; empty if it states none."""
    axes = robot.controller_axes or robot.axes if robot.controller == "constants" else ()
    return tuple(LinkConstants(**{key: getattr(axis, key) for key in LinkConstants.model_fields}) for axis in axes)


def robot_with(rig: Rig, read: ControllerConstants) -> Robot:
    """Robot of a rig with the constants of its controller. Equal constants change nothing."""
    origin = {"controller_source": read.source, "linear_units": read.linear_units or rig.robot.linear_units}
    held = constants_in(rig.robot)
    if held and read.arm == "constants" and _apart_mm(rig.robot, held, read.axes) < _SAME_MM:
        return rig.robot.model_copy(update=origin)
    robot = rig.robot.model_copy(update={"controller": read.arm, "controller_axes": (), **origin})
    if held and read.arm != "constants":
        return robot.model_copy(update={"axes": read.axes})
    if read.arm == "constants" and (rig.effects or rig.calibration):
        own = tuple(
            LinkConstants(**{key: getattr(axis, key) for key in LinkConstants.model_fields}) for axis in read.axes
        )
        robot = robot.model_copy(update={"controller_axes": own})
    elif read.arm == "constants":
        robot = robot.model_copy(update={"axes": read.axes})
    return robot


def _apart_mm(robot: Robot, held: Sequence[LinkConstants], axes: Sequence[JointAxis]) -> float:
    """Largest distance of the flange between two sets of constants."""
    own = tuple(axis.model_copy(update=dict(constants)) for axis, constants in zip(axes, held, strict=True))
    q = random_postures(robot)
    poses = (flange_poses(_bare(robot, each), q) for each in (own, tuple(axes)))
    return largest_difference(*poses)[0]


def _bare(robot: Robot, axes: tuple[JointAxis, ...]) -> Robot:
    nothing = {"base": Pose(), "tool": Pose(), "controller": None, "controller_axes": ()}
    return robot.model_copy(update={"axes": axes, **nothing})


def refuse_other_constants(rig: Rig, read: ControllerConstants, where: str) -> None:
    """Refuse constants other than those with which an arm was diagnosed. Raises FileError.

    The effects of a rig file are relative to the constants of the diagnosis. Pins of LinuxCNC may have been entered
    since, so small changes of them are corrected relative to the present ones.
    """
    held = constants_in(rig.robot)
    if not held or not (rig.effects or rig.calibration):
        return
    known = rig.robot.controller_source
    name = f" ({' '.join(filter(None, (known.file, known.serial)))})" if known else ""
    remedy = "give the file of this robot, or diagnose again with this one"
    if read.arm != "constants":
        problem = f"contradicts the constants of the controller with which the arm was diagnosed{name}"
        raise FileError(where, problem, remedy, code="robot.other")
    apart_mm = _apart_mm(rig.robot, held, read.axes)
    # Pins may have been entered since the diagnosis.
    if apart_mm > (largest_correction_mm(rig.robot) if read.linear_units else _SAME_MM):
        problem = f"holds other constants than those of the diagnosis{name}: they move the flange by {apart_mm:.2f} mm"
        raise FileError(where, problem, remedy, code="robot.other")


def largest_correction_mm(robot: Robot) -> float:
    """Largest displacement of the tool that is corrected: by a zero wrong by `MOST_ZERO_DEG`, at full reach."""
    return float(np.radians(MOST_ZERO_DEG)) * robot.reach_mm


def data_sheet_of(robot: Robot) -> Robot:
    """Robot with the constants of the data sheet, without base and tool.

    If the axes are those of a controller, they are those of the arm that the robot names. Raises FileError if it names
    none.
    """
    bare = _bare(robot, robot.axes)
    if robot.controller != "constants" or robot.controller_axes:
        return bare
    if not robot.arm:
        problem = "has the constants of a controller, and no `arm` that names the data sheet"
        raise FileError(
            f"{robot.name}, robot", problem, "add `arm: NAME` (rig arms lists the names)", code="rig_file.invalid"
        )
    return bare.model_copy(update={"axes": load_arm(robot.arm).robot.axes})


def constants_from_poses(robot: Robot, q: Array, xyz_mm: Array, R: Array | None, where: str) -> ControllerConstants:
    """Determine the constants of a controller from flange poses that it computed; R (n, 3, 3) if reported.

    Raises FileError if no constants fit, or if the poses do not determine them.
    """
    arm = arm_of(robot)
    base = _base_of(arm, q, xyz_mm)
    xyz_mm, R = xyz_mm @ base, None if R is None else base @ R
    apart_mm = float(np.linalg.norm(forward(arm, q)[:, :3, 3] - xyz_mm, axis=1).max())
    rounding_mm = _rounding_mm(arm, q)
    practice = practice_of(robot.name)
    if apart_mm <= rounding_mm and practice and practice.own_constants == "always" and len(q) < _PROVES:
        problem = f"agrees with the data sheet to {apart_mm:.2f} mm, as a single pose of own constants may"
        raise FileError(
            where,
            problem,
            f"give {_PROVES} poses or more, or the constants of the controller",
            code="readings.too_few",
        )
    if apart_mm <= rounding_mm:
        words = f"{where}: the controller computes with the data sheet, to {apart_mm:.3f} mm in {len(q)} poses"
        return ControllerConstants(robot.axes, "data_sheet", apart_mm, words)
    fitted = fit_constants(arm, q, xyz_mm, R)
    if fitted.spare < _SPARE:
        problem = (
            f"the controller does not compute with the data sheet: {len(q)} poses differ by up to {apart_mm:.2f} mm"
        )
        remedy = "to determine its constants give calibration.conf, or 20 poses in which all joints move; tool: none"
        raise FileError(where, problem, remedy, code="controller.invalid")
    if fitted.rms_mm > _RESIDUAL_MM:
        problem = f"no link constants of {robot.name} match the flange poses: {fitted.rms_mm:.3g} mm rms remain"
        raise FileError(
            where,
            problem,
            "set the tool of the controller to none, and give flange poses and joints",
            code="controller.invalid",
        )
    if undetermined_mm(fitted, random_postures(robot)) > _UNDETERMINED_MM:
        problem = f"the controller has constants of its own ({apart_mm:.2f} mm apart), undetermined by these postures"
        raise FileError(
            where,
            problem,
            "give calibration.conf, or 20 poses in which all joints move; tool: none",
            code="controller.invalid",
        )
    axes = tuple(_with_constants(axis, fitted.arm, k) for k, axis in enumerate(robot.axes))
    own = robot.model_copy(update={"axes": axes})
    postures = random_postures(robot)
    moved_mm, _ = largest_difference(flange_poses(own, postures), flange_poses(robot, postures))
    words = (
        f"{where}: the controller's own constants, to {1e3 * fitted.rms_mm:.2g} µm; they move the flange by up to "
        f"{moved_mm:.3f} mm, and do not show the true position: this needs an instrument"
    )
    return ControllerConstants(axes, "constants", moved_mm, words)


def _base_of(arm: Arm, q: Array, xyz_mm: Array) -> Array:
    """Turn (3, 3) of the poses' base: none, or half a turn about z, as base_link of ROS drivers has it."""
    T, half = forward(arm, q), np.diag([-1.0, -1.0, 1.0])
    if len(q) > 3:  # the frame is determined, whatever the tool
        seen = fit_setup(T, xyz_mm).T_world_base[:3, :3]
        return half if np.trace(seen[:2, :2]) < 0 else np.eye(3)
    return min((np.eye(3), half), key=lambda base: float(np.linalg.norm(T[:, :3, 3] - xyz_mm @ base)))


def _rounding_mm(arm: Arm, q: Array) -> float:
    """Largest distance in mm that the rounding of joint angles and places explains: the decimals of the angles in
    degrees, and 0.01 mm of pendants.
    """
    degrees = np.degrees(q)
    rounded = [np.abs(degrees - np.round(degrees, k)).max() < 10.0 ** -(k + 3) for k in range(_MOST_DECIMALS)]
    decimals = rounded.index(True) if True in rounded else _MOST_DECIMALS
    reach_mm = float(np.abs(arm.a).sum() + np.abs(arm.d).sum())
    return 0.02 + reach_mm * float(np.radians(0.5 * 10.0**-decimals)) * float(np.sqrt(arm.axes))


def _with_constants(axis: JointAxis, arm: Arm, k: int) -> JointAxis:
    degrees = {f"{name}_deg": np.degrees(getattr(arm, name)[k]) for name in ("alpha", "beta", "offset")}
    constants = {"a_mm": arm.a[k], "d_mm": arm.d[k], **degrees}
    return axis.model_copy(update={key: float(np.round(value, _DIGITS)) + 0.0 for key, value in constants.items()})
