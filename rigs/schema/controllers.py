"""Practice of the makers: whether a controller computes poses with the data sheet or with constants of its own robot.

A robot measured at the factory has its own constants, which differ from the data sheet by up to 1 mm and 0.8°.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Practice:
    own_constants: Literal["always", "option"]
    source: str
    get: str
    are_entered: bool = False
    """True if the constants are those of the data sheet until a person enters others."""


_PAIRS = "20 rows of joint angles and flange pose from the pendant"
PRACTICE: dict[str, Practice] = {
    "universalrobots": Practice(
        "always",
        "Universal Robots, ROS driver, ur_calibration: each robot is calibrated in the factory",
        "calibration.conf of the controller, or the YAML that ur_calibration writes",
    ),
    "ufactory": Practice(
        "option",
        "xarm_ros2, readme, kinematics_suffix: robots made after August 2023",
        _PAIRS,
    ),
    "kuka": Practice("option", "KUKA, option High Accuracy (absolutely accurate robot, PID file)", _PAIRS),
    "abb": Practice("option", "ABB, option Absolute Accuracy (3HAC050798, Configuring motion, moc.cfg)", _PAIRS),
    "fanuc": Practice("option", "FANUC, option iRCalibration Signature", _PAIRS),
    "linuxcnc": Practice(
        "always", "LinuxCNC, kins(9): the pins of genserkins in a HAL file", "the INI file", are_entered=True
    ),
    "yaskawa": Practice("option", "Yaskawa, option absolute calibration (ABSO), file ABSO.DAT", _PAIRS),
}


def practice_of(maker: str) -> Practice | None:
    """Practice of a maker by any spelling of the name: Universal Robots, UR and FANUC; None if it is not known."""
    letters = "".join(char for char in maker.casefold() if char.isalnum())
    if letters == "ur":
        letters = "universalrobots"
    return next((practice for name, practice in PRACTICE.items() if letters.startswith(name)), None)
