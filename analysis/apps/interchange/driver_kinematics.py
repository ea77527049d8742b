"""Export of an arm as the joint origins of a maker's ROS description: kinematics.yaml, or calibration.yaml for
Universal Robots. Neither contains the base or the tool of a rig file.

The frames of the maker and of the rig file turn about the same axes on the same links, so each pair differs by a
constant frame, computed from the nominal arm. Nominal origins: frankaemika/franka_description,
robots/fer/kinematics.yaml, commit 1ddff9b (the FR3 has the same lengths); xArm-Developer/xarm_ros,
xarm_description/config/kinematics/default, commits a083c36 and 74e75cf, with right angles in place of 1.5708.

calibration.yaml has the origin of each joint in m and rad. The first belongs to base_link_inertia, equal to the
controller's base. Source: ros-industrial/universal_robot, ur_description/urdf/inc/ur_macro.xacro, commit 0290bd2.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import yaml

from analysis.apps.interchange.urdf_text import joint_origins, joint_senses, metres_and_rpy
from analysis.robot.description.ur_calibration import NOT_THE_CONTROLLERS
from analysis.robot.kinematics.arm import Arm, Array, arm_of, transform
from rigs.errors import FileError, UseError
from rigs.schema.robot import Pose, Robot
from rigs.text import escape_text

Origin = tuple[float, float, float, float, float, float]
"""x, y, z in mm and roll, pitch, yaw in degrees."""
_SAME_MM, _SAME_RAD = 0.5, 1e-4
"""Tolerances for equal axes of the nominal arm and of the maker. Data sheets round to a tenth of a mm."""


@dataclass(frozen=True)
class KinematicsFormat:
    origins: tuple[Origin, ...]
    flange: Origin | None = None
    above: str | None = None
    """Key of the file that contains all joints."""
    below: str | None = None
    """Key of each joint that contains its origin."""


_FRANKA = KinematicsFormat(
    origins=(
        (0, 0, 333, 0, 0, 0),
        (0, 0, 0, -90, 0, 0),
        (0, -316, 0, 90, 0, 0),
        (82.5, 0, 0, 90, 0, 0),
        (-82.5, 384, 0, -90, 0, 0),
        (0, 0, 0, 90, 0, 0),
        (88, 0, 0, 90, 0, 0),
    ),
    flange=(0, 0, 107, 0, 0, 0),
    below="kinematic",
)
_XARM_6 = KinematicsFormat(
    origins=(
        (0, 0, 267, 0, 0, 0),
        (0, 0, 0, -90, 0, 0),
        (53.5, -284.5, 0, 0, 0, 0),
        (77.5, 342.5, 0, -90, 0, 0),
        (0, 0, 0, 90, 0, 0),
        (76, 97, 0, -90, 0, 0),
    ),
    above="kinematics",
)
_XARM_7 = KinematicsFormat(
    origins=(
        (0, 0, 267, 0, 0, 0),
        (0, 0, 0, -90, 0, 0),
        (0, -293, 0, 90, 0, 0),
        (52.5, 0, 0, 90, 0, 0),
        (77.5, -342.5, 0, 90, 0, 0),
        (0, 0, 0, 90, 0, 0),
        (76, 97, 0, -90, 0, 0),
    ),
    above="kinematics",
)
LAYOUTS: dict[str, tuple[KinematicsFormat, ...]] = {"franka": (_FRANKA,), "xarm": (_XARM_6, _XARM_7)}


def driver_kinematics(robot: Robot, arm: Arm, maker: str, where: str, remarks: Sequence[str] = ()) -> str:
    """Write kinematics.yaml of a calibrated arm for the description of a maker.

    robot: nominal arm of the rig file. maker: a key of LAYOUTS. Raises FileError for an arm of a different maker.
    """
    joint_senses(arm, where, "kinematics.yaml")
    # Find the layout with the axes of the nominal arm: each pair of frames shares the axis, and the flange is common.
    # `between`: the maker's frame of each link in the frame of the rig file, with all joints at zero.
    for layout in (layout for layout in LAYOUTS[maker] if len(layout.origins) == arm.axes):
        ours, theirs, between = np.eye(4), np.eye(4), list[Array]()
        for T, origin in zip(joint_origins(arm_of(robot)), layout.origins, strict=True):
            ours, theirs = ours @ T, theirs @ _frame(origin)
            between.append(np.linalg.inv(ours) @ theirs)
        flange = between[-1] @ (np.eye(4) if layout.flange is None else _frame(layout.flange))
        if np.abs(flange - np.eye(4)).max() < _SAME_MM and all(
            np.hypot(T[0, 3], T[1, 3]) < _SAME_MM and np.arccos(min(T[2, 2], 1.0)) < _SAME_RAD for T in between
        ):
            break
    else:
        raise _wrong_kind(where, f"kinematics.yaml of {maker}")
    origins = [*(T @ end for T, end in zip(joint_origins(arm), between, strict=True))]
    if layout.flange is not None:
        origins.append(np.eye(4))
    entries: dict[str, object] = {}
    for number, (start, T) in enumerate(zip([np.eye(4), *between], origins, strict=False), start=1):
        entry = _entry(np.linalg.inv(start) @ T)
        entries[f"joint{number}"] = {layout.below: entry} if layout.below else entry
    return _yaml({layout.above: entries} if layout.above else entries, remarks)


def _wrong_kind(where: str, file: str) -> FileError:
    problem, remedy = f"the kinematics of the arm do not match {file}", "export a URDF, which can describe any arm"
    return FileError(f"{where}, robot.axes", problem, remedy, code="output.invalid")


def _entry(T: Array) -> dict[str, float]:
    xyz, rpy = metres_and_rpy(T)
    return dict(zip(("x", "y", "z", "roll", "pitch", "yaw"), (*xyz, *rpy), strict=True))


def _yaml(content: dict[str, object], remarks: Sequence[str]) -> str:
    return "".join(f"# {escape_text(remark)}\n" for remark in remarks) + yaml.safe_dump(content, sort_keys=False)


def _frame(origin: Origin) -> Array:
    return transform(Pose(xyz_mm=origin[:3], rpy_deg=origin[3:]))


LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
_HASH = re.compile(r"calib_\d{1,20}")
"""Format of the driver's hash: a number of 64 bits."""
_TWISTS_DEG = (0.0, 90.0, 0.0, 0.0, 90.0, -90.0)
"""alpha of all arms of the maker, from its published DH parameters, in Craig's form."""
_MOST_DEG = 5.0
"""Maximum deviation, larger than any deformation. Arms of other makers differ by right angles."""


def ur_driver_text(arm: Arm, where: str, calibration_hash: str | None = None, remarks: Sequence[str] = ()) -> str:
    """Write calibration.yaml of an arm, with the hash from the file extracted by the driver's tool.

    Raises FileError for an arm of a different kind, and UseError for an invalid hash.
    """
    if calibration_hash is not None and not _HASH.fullmatch(calibration_hash):
        problem = f"{calibration_hash!r} is not a valid hash of the driver"
        remedy = "copy the hash from the file extracted by the driver: calib_ and digits"
        raise UseError("--hash", problem, remedy, code="output.invalid")
    off_deg = np.abs(np.degrees(arm.alpha) - _TWISTS_DEG)
    if (off_deg > _MOST_DEG).any() or -1 in joint_senses(arm, where, "calibration.yaml"):
        raise _wrong_kind(where, "calibration.yaml of Universal Robots")
    links: dict[str, object] = {link: _entry(T) for link, T in zip(LINKS, joint_origins(arm), strict=True)}
    return _yaml({"kinematics": {**links, "hash": calibration_hash or NOT_THE_CONTROLLERS}}, remarks)
