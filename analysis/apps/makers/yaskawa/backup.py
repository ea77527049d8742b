"""The condition files of a Yaskawa backup: tools and user frames.

Source: TOOL.CND and UFRAME.CND of DX and YRC controllers. The first line of numbers of a tool, and BUSER of a user
frame (in the base of the robot), are X, Y, Z in mm and Rx, Ry, Rz in degrees.
"""

from __future__ import annotations

import re

from analysis.apps.makers.numbers import frame_of, is_frame
from analysis.apps.makers.points import as_value
from analysis.apps.makers.program_machine import Value
from analysis.apps.makers.program_parser import NUMBER

TABLES = ("tool.cnd", "uframe.cnd")
_SIX = r"\s*,\s*".join([f"({NUMBER})"] * 6)
_SECTION = re.compile(r"^//(TOOL|UFRAME)[ \t]+(\d+)[ \t]*$(.*?)(?=^//[A-Z]|\Z)", re.MULTILINE | re.DOTALL)
_NUMBERS = {
    "TOOL": re.compile(rf"^[ \t]*{_SIX}[ \t]*$", re.MULTILINE),
    "UFRAME": re.compile(rf"^////BUSER\s+{_SIX}", re.MULTILINE),
}
_OTHER_ROBOT = re.compile(r"^///GROUP[ \t]+0\b", re.MULTILINE)
"""A user frame that does not belong to the first robot."""


def frames_in(tables: tuple[tuple[str, str], ...]) -> dict[str, Value]:
    """Tools TOOL[n] and user frames USER[n]."""
    found: dict[str, Value] = {}
    for _, text in tables:
        for section in _SECTION.finditer(text.replace("\r", "")):
            stated = _NUMBERS[section[1]].search(section[3])
            numbers = [float(number) for number in stated.groups()] if stated else []
            if numbers and is_frame("roll_pitch_yaw", numbers) and not _OTHER_ROBOT.search(section[3]):
                family = section[1].replace("UFRAME", "USER")
                found[f"{family}[{int(section[2])}]"] = as_value(frame_of("roll_pitch_yaw", numbers))
    return found
