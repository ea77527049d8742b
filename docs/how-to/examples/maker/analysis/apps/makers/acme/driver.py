"""An emulated controller of Acme, from the manual and apart from the writer: what the manual has not is refused."""

from __future__ import annotations

import math
import re

import numpy as np
from scipy.spatial.transform import Rotation

from analysis.apps.makers.emulated import (
    Array,
    ControllerParameter,
    Machine,
    MoveLimits,
    OperatorPause,
    ProgramDriver,
    ProgramError,
    Switched,
    ToolPose,
    Turning,
)

_INSTRUCTION = re.compile(
    r"(?P<word>TOOL|JOINTS|LINE|TURN|VIA|ARC|WAIT|OUTPUT|PAUSE)(?: (?P<numbers>-?\d[-\d.,]*))?"
    r"(?: SPEED (?P<speed>[\d.]+))?(?P<path> PATH)?(?P<blend> BLEND)?(?P<state> ON| OFF)?"
)


def run(text: str, _: str, machine: Machine) -> None:
    """Drive the machine with a program. Raises ProgramError for one that is refused."""
    via: Array | None = None
    for line in text.split("\r\n"):
        instruction = _INSTRUCTION.fullmatch(line)
        if instruction:
            via = _do(instruction, via, machine)
        elif line and not line.startswith("; "):
            raise ProgramError(f"{line[:20]!r} is no instruction")


def _do(instruction: re.Match[str], via: Array | None, machine: Machine) -> Array | None:
    """Do an instruction, and return the place (3,) mm through which the next arc leads."""
    values = np.array([float(number) for number in (instruction["numbers"] or "").split(",") if number])
    speed, stops = float(instruction["speed"] or 0), not instruction["blend"]
    match instruction["word"], len(values):
        case "TOOL", 6:
            machine.tool = _pose(values)
        case "JOINTS", 6:
            machine.joints(np.radians(values), MoveLimits(axis_rad_s=math.radians(speed)))
        case "LINE", 6:
            machine.line(_pose(values), speed, stops=stops, speed=MoveLimits(mm_s=speed))
        case "TURN", 6:
            machine.turn(_pose(values), math.radians(speed))
        case "VIA", 6:
            return values[:3]
        case "ARC", 6 if via is not None:
            turning: Turning = "fixed to path" if instruction["path"] else "even"
            machine.arc(via, _pose(values), speed, turning=turning, stops=stops, speed=MoveLimits(mm_s=speed))
        case "WAIT", 1:
            machine.wait(float(values[0]))
        case "OUTPUT", 1 if instruction["state"]:
            machine.events.append(Switched(int(values[0]), instruction["state"] == " ON"))
        case "PAUSE", 0:
            machine.events.append(OperatorPause())
        case _:
            raise ProgramError(f"{instruction[0][:20]!r} is no instruction")
    return None


def _pose(values: Array) -> ToolPose:
    return ToolPose(values[:3], Rotation.from_euler("xyz", values[3:], degrees=True))


DRIVER = ProgramDriver(run, (ControllerParameter("zero of axis {axis}", "deg", "reading", -math.radians(1)),))
"""An axis reads the angle of its motor less its zero."""
