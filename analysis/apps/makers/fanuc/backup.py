"""The system variables of a FANUC backup: tools, user frames and the lengths of the arm.

Source: SYSFRAME.VA and SYMOTN.VA of R-30iA and R-30iB backups: $MNUTOOL[group,n] and $MNUFRAME[group,n] are the tools
and user frames in mm and degrees, $MRR_GRP[group].$DH_A the lengths of the arm in mm.
"""

from __future__ import annotations

import re

from analysis.apps.makers.backup_arm import other_lengths
from analysis.apps.makers.numbers import frame_of, is_frame
from analysis.apps.makers.points import as_value
from analysis.apps.makers.program_machine import Value
from analysis.apps.makers.program_parser import NUMBER
from analysis.apps.makers.target import ProgramTexts
from rigs.schema.robot import Robot

FRAMES, ARM = "sysframe.va", "symotn.va"
_VARIABLE = re.compile(r"^\[\*SYSTEM\*\]\$MNU(TOOL|FRAME)\s[^\n]*\n(.*?)(?=^\[|\Z)", re.MULTILINE | re.DOTALL)
_ELEMENT = re.compile(
    r"\[1,(\d+)\]\s*=[^\n]*\s+Group:\s*1\b[^\n]*\s+" + r"\s+".join(rf"{axis}:\s*({NUMBER})" for axis in "XYZWPR")
)
_LENGTHS = re.compile(
    r"\$MRR_GRP\[1\]\.\$DH_A\s+ARRAY[^\n]*" + "".join(rf"\s+\[{k}\]\s*=\s*({NUMBER})(?!\S)" for k in (1, 2, 3))
)


def frames_in(tables: tuple[tuple[str, str], ...]) -> dict[str, Value]:
    """Tools UTOOL[n] and user frames UFRAME[n] of the arm's motion group."""
    found: dict[str, Value] = {}
    for name, text in tables:
        for variable in _VARIABLE.finditer(text.replace("\r", "")) if name.lower() == FRAMES else ():
            for element in _ELEMENT.finditer(variable[2]):
                numbers = [float(number) for number in element.groups()[1:]]
                if is_frame("roll_pitch_yaw", numbers):
                    found[f"U{variable[1]}[{int(element[1])}]"] = as_value(frame_of("roll_pitch_yaw", numbers))
    return found


def other_arm(program: ProgramTexts, robot: Robot) -> str:
    """Explain which lengths of the backup differ from those of a robot; empty if they fit."""
    for name, text in program.tables:
        if name.lower() == ARM and (lengths := _LENGTHS.search(text.replace("\r", ""))):
            return other_lengths(name, {axis: float(mm) for axis, mm in enumerate(lengths.groups(), start=2)}, robot)
    return ""
