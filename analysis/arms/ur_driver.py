"""An arm of Universal Robots as the kinematics file of its ROS and ROS 2 driver, calibration.yaml.

The package ur_description makes a URDF of it: each entry is the origin of a joint in metres and radians, turning about
z; the first stands in base_link_inertia, which is base_link turned half round about z and equal to the controller's
base; tool0 is the frame of wrist_3. The base and the tool of a rig file have no place in it. Source:
ros-industrial/universal_robot, ur_description/urdf/inc/ur_macro.xacro, commit 0290bd2.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
import yaml

from analysis.arms.joint_origins import joint_origins, joint_senses, metres_and_rpy
from analysis.kinematics.arm import Arm
from rigs.errors import FileError, UseError
from rigs.text import plain

LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
"""The entries of the file, from the base."""
NOT_THE_CONTROLLERS = "rig_not_of_the_controller"
"""The hash where none is given. The driver compares it with the checksum of the calibration inside the controller and
reports at each start that they differ, which is true."""
_HASH = re.compile(r"calib_\d{1,20}")
"""As the driver makes it: a number of 64 bits."""
_TWISTS_DEG = (0.0, 90.0, 0.0, 0.0, 90.0, -90.0)
"""alpha of all arms of the maker (its DH parameters for calculations of kinematics and dynamics, as modified ones)."""
_MOST_DEG = 5.0
"""No arm is bent so far; those of other makers differ by right angles."""


def ur_driver_text(arm: Arm, where: str, calibration_hash: str | None = None, remarks: Sequence[str] = ()) -> str:
    """Return calibration.yaml of an arm.

    where: the rig file, for errors. calibration_hash: that of the file which the driver's own tool extracted. remarks:
    lines at the head. Raises FileError for an arm of another kind, UseError for a hash that is none.
    """
    if calibration_hash is not None and not _HASH.fullmatch(calibration_hash):
        problem = f"{calibration_hash!r} is not a hash of the driver"
        raise UseError("--hash", problem, "copy it from the file that the driver extracted: calib_ and digits")
    off_deg = np.abs(np.degrees(arm.alpha) - _TWISTS_DEG)
    if (off_deg > _MOST_DEG).any() or -1 in joint_senses(arm, where, "calibration.yaml"):
        problem = "the arm is not built as one of Universal Robots, for whose driver calibration.yaml is"
        raise FileError(f"{where}, robot.axes", problem, "leave out --for ur-driver: a URDF describes any arm")
    kinematics: dict[str, object] = {}
    for link, T in zip(LINKS, joint_origins(arm), strict=True):
        xyz, rpy = metres_and_rpy(T)
        kinematics[link] = dict(zip(("x", "y", "z", "roll", "pitch", "yaw"), (*xyz, *rpy), strict=True))
    kinematics["hash"] = calibration_hash or NOT_THE_CONTROLLERS
    head = "".join(f"# {plain(remark)}\n" for remark in remarks)
    return head + yaml.safe_dump({"kinematics": kinematics}, sort_keys=False)
