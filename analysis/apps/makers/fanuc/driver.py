"""Interpreter of FANUC's teach pendant language (.LS) for emulated controllers.

Source: FANUC, R-30iB Operator's Manual B-83284EN, chapter 4. W, P, R rotate about the fixed x, y, z axes in this order.
A circular move rotates the tool evenly. CONFIG contains F or N for the wrist, flipped or not, and the turns of J4, J5
and J6 (HandlingTool, section 11.21.2: 1 from 180° to 539°).
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from analysis.apps.makers.emulated import (
    COUNTS_PER_DEG,
    READING,
    Array,
    ConfigurationFlags,
    ControllerParameter,
    Machine,
    MoveLimits,
    OperatorPause,
    ProgramDriver,
    ProgramError,
    Switched,
    ToolPose,
)

_NAME = re.compile(r"[A-Z][A-Z0-9_]{0,35}")
_NUMBER = r"(-?\d*\.?\d+)"
_HEADER = re.compile(
    r"/PROG  (\S+)\n/ATTR\nCOMMENT\t\t= \"[^\"\n]*\";\nDEFAULT_GROUP\t= 1,\*,\*,\*,\*;\n"
    r"/MN\n(.*\n)/POS\n((?:.*\n)?)/END\n",
    re.S,
)
_LINE = re.compile(r" *(\d+):(.*?) ;\n", re.S)
_POSITION = re.compile(r"P\[(\d+)\]\{\n   GP1:\n\tUF : (\d+), UT : (\d+),(.*?)\n\};\n", re.S)
_JOINTS = re.compile(r"\n\t" + r",\s*".join(rf"J{axis}= *{_NUMBER} deg" for axis in range(1, 7)))
_PLACES = [rf"{axis} = *{_NUMBER} mm" for axis in "XYZ"] + [rf"{axis} = *{_NUMBER} deg" for axis in "WPR"]
_CONFIG = r"\t\tCONFIG : '([NF]) [UD] [TB], (-?\d+), (-?\d+), (-?\d+)',\n\t"
_CARTESIAN = re.compile(_CONFIG + r",\s*".join(_PLACES))


@dataclass(frozen=True)
class _Position:
    user_frame: int
    tool: int
    pose: ToolPose | None
    q: Array | None


def run(text: str, _: str, machine: Machine) -> None:
    if "\r\n" not in text:
        raise ProgramError("lines end with CR LF")
    match = _HEADER.fullmatch(text.replace("\r\n", "\n"))
    if not match or not _NAME.fullmatch(match[1]):
        raise ProgramError("the sections /PROG /ATTR /MN /POS /END are not in order")
    lines, at, body = list[str](), 0, match[2]
    while at < len(body):
        numbered = _LINE.match(body, at)
        if not numbered or int(numbered[1]) != len(lines) + 1 or ";" in numbered[2]:
            raise ProgramError(f"{body[at : at + 40]!r} is not line {len(lines) + 1}")
        lines.append(numbered[2])
        at = numbered.end()
    _FanucController(_positions(match[3]), machine).obey(lines)


def _positions(text: str) -> dict[int, _Position]:
    positions, at = {}, 0
    while at < len(text):
        match = _POSITION.match(text, at)
        if not match or int(match[1]) in positions:
            raise ProgramError(f"{text[at : at + 40]!r} is not a position")
        joints, cartesian = _JOINTS.fullmatch(match[4]), _CARTESIAN.fullmatch(match[4])
        if joints:
            pose, q = None, np.radians([float(value) for value in joints.groups()])
        elif cartesian:
            flip, *counts = cartesian.groups()[:4]
            configuration = ConfigurationFlags(flip == "F", tuple(map(int, counts)))
            pose, q = (
                replace(_pose([float(value) for value in cartesian.groups()[4:]]), configuration=configuration),
                None,
            )
        else:
            raise ProgramError(f"the coordinates {match[4]!r} are not in FANUC format")
        positions[int(match[1])] = _Position(int(match[2]), int(match[3]), pose, q)
        at = match.end()
    return positions


def _pose(values: list[float]) -> ToolPose:
    return ToolPose(np.array(values[:3]), Rotation.from_euler("xyz", values[3:], degrees=True))


class _FanucController:
    def __init__(self, positions: dict[int, _Position], machine: Machine) -> None:
        self._positions, self._machine = positions, machine
        self._register: dict[int, list[float]] = {}
        self._tools: dict[int, ToolPose] = {}
        self._frame = self._tool = -1

    def obey(self, lines: list[str]) -> None:
        for line in lines:
            if line.startswith("  !"):
                if len(line) > 3 + 32:
                    raise ProgramError(f"the remark {line!r} is longer than 32 characters")
            elif match := re.fullmatch(r"J P\[(\d+)\] (\d+)% FINE", line):
                position = self._at(match[1])
                if position.q is None or not 1 <= int(match[2]) <= 100:
                    raise ProgramError("this interpreter supports joint moves only to joint positions, at 1 to 100 %")
                self._machine.joints(position.q, MoveLimits(share=int(match[2]) / 100))
            elif match := re.fullmatch(rf"L P\[(\d+)\] {_NUMBER}mm/sec (FINE|CNT0)", line):
                self._machine.line(self._pose_at(match[1]), float(match[2]), stops=match[3] == "FINE")
            elif match := re.fullmatch(rf"L P\[(\d+)\] {_NUMBER}deg/sec FINE", line):
                self._machine.turn(self._pose_at(match[1]), np.radians(float(match[2])))
            elif match := re.fullmatch(rf"C P\[(\d+)\]\n    :  P\[(\d+)\] {_NUMBER}mm/sec (FINE|CNT100)", line):
                via, end = self._pose_at(match[1]), self._pose_at(match[2])
                stops, speed_mm_s = match[4] == "FINE", float(match[3])
                self._machine.arc(via.place, end, speed_mm_s, turning="even", stops=stops)
            else:
                self._act(line)

    def _act(self, line: str) -> None:
        if match := re.fullmatch(r"  UFRAME_NUM=(\d)", line):
            self._frame = int(match[1])
        elif match := re.fullmatch(r"  UTOOL_NUM=(\d)", line):
            self._tool = int(match[1])
            self._machine.tool = self._tools[self._tool]
        elif match := re.fullmatch(r"  PR\[(\d+)\]=LPOS", line):
            self._register[int(match[1])] = [np.nan] * 6
        elif match := re.fullmatch(rf"  PR\[(\d+),([1-6])\]=(?:(\d+\.\d+)|\({_NUMBER}\))", line):
            self._register[int(match[1])][int(match[2]) - 1] = float(match[3] or match[4])
        elif match := re.fullmatch(r"  UTOOL\[(\d)\]=PR\[(\d+)\]", line):
            self._tools[int(match[1])] = _pose(self._register[int(match[2])])
        elif match := re.fullmatch(r"  WAIT (\d+\.\d\d)\(sec\)", line):
            self._machine.wait(float(match[1]))
        elif match := re.fullmatch(r"  DO\[(\d+)\]=(ON|OFF)", line):
            self._machine.events.append(Switched(int(match[1]), match[2] == "ON"))
        elif line == "  PAUSE":
            self._machine.events.append(OperatorPause())
        else:
            raise ProgramError(f"{line!r} is not an instruction")

    def _at(self, number: str) -> _Position:
        if int(number) not in self._positions:
            raise ProgramError(f"P[{number}] is not taught")
        position = self._positions[int(number)]
        if (position.user_frame, position.tool) != (self._frame, self._tool):
            raise ProgramError(f"P[{number}] belongs to a different frame or tool")
        return position

    def _pose_at(self, number: str) -> ToolPose:
        pose = self._at(number).pose
        if pose is None:
            raise ProgramError(f"P[{number}] has joint angles, but this interpreter needs a pose")
        return pose


DRIVER = ProgramDriver(
    run,
    (
        READING,
        ControllerParameter("$DMR_GRP[1].$MASTER_COUN[{axis}]", "counts", "reading", -math.radians(1) / COUNTS_PER_DEG),
        ControllerParameter("$PARAM_GROUP[1].$DH_A[{axis}]", "mm", "a", 1.0, later=1, grows=True),
        ControllerParameter("$PARAM_GROUP[1].$DH_D[{axis}]", "mm", "d", 1.0, grows=True),
    ),
)
