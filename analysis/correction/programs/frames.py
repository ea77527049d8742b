"""Tools and frames that a program only names: a person states them, since they stand in the controller."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from analysis.kinematics.arm import Array, transform
from rigs.errors import UseError
from rigs.schema.robot import Pose, Robot

_HOW = "give NAME=X,Y,Z,RX,RY,RZ in mm and degrees, roll-pitch-yaw about fixed axes"
_LARGEST = 1e6
"""mm; a frame farther away than a kilometre is a typing error."""


@dataclass(frozen=True)
class Frames:
    """Frames (4, 4) in mm by their names, in lower case: tools from the flange, user frames from the robot's base."""

    tools: Mapping[str, Array]
    frames: Mapping[str, Array]


NO_FRAMES = Frames({}, {})
"""Nothing stated: what a program only names is not known."""


def frames_of(robot: Robot, tools: Sequence[str], frames: Sequence[str]) -> Frames:
    """Return the frames of texts "name=x,y,z,rx,ry,rz"; a tool can be "name=rig", the tool of the rig file, and either
    "name=0". Raises UseError for anything else."""
    tool_frames = dict(_named("--tool", text, transform(robot.tool)) for text in tools)
    return Frames(tool_frames, dict(_named("--frame", text, None) for text in frames))


def _named(option: str, text: str, of_rig: Array | None) -> tuple[str, Array]:
    name, equals, values = (part.strip() for part in text.partition("="))
    if not equals or not name:
        raise UseError(f"{option} {text}", "is not NAME=…", _HOW)
    if values == "rig" and of_rig is not None:
        return name.lower(), of_rig
    if values == "0":
        return name.lower(), np.eye(4)
    try:
        numbers = [float(value) for value in values.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != 6 or not all(abs(value) < _LARGEST for value in numbers):
        raise UseError(f"{option} {text}", "is not six numbers", _HOW)
    return name.lower(), transform(Pose(xyz_mm=tuple(numbers[:3]), rpy_deg=tuple(numbers[3:])))
