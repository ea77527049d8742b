"""Interpreter of RAPID for emulated controllers: a module with data and one procedure.

Source: ABB, Technical reference manual 3HAC050917. Quaternions are scalar first. MoveC rotates the tool from start to
end relative to the path, or evenly in space, as set by CirPathMode PathFrame or ObjectFrame.
"""

from __future__ import annotations

import json
import re
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from analysis.apps.makers.emulated import (
    GEAR_RATIO,
    READING,
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

_MODULE = re.compile(
    r"\s*MODULE (\w+)((?:\s*LOCAL [^;]*;)*)\s*PROC (\w+)\(\)((?:[^;]*;)*)\s*ENDPROC\s*ENDMODULE\s*", re.ASCII
)
_COMMENT = re.compile(r"(\"[^\"]*\")|![^\n]*")
_WORD = re.compile(r"\"[^\"]*\"|[A-Za-z]\w*|-?\d+(?:\.\d+)?|:=|\S")
_DATA = re.compile(r"LOCAL (?:CONST|PERS) (\w+) (\w+):=(.*)")
_POSE = "[[n,n,n],[n,n,n,n]]"
_KINDS = {
    "tooldata": f"[b,{_POSE},[n,[n,n,n],[n,n,n,n],n,n,n]]",
    "wobjdata": f"[b,b,t,{_POSE},{_POSE}]",
    "jointtarget": "[[n,n,n,n,n,n],[n,n,n,n,n,n]]",
    "robtarget": "[[n,n,n],[n,n,n,n],[n,n,n,n],[n,n,n,n,n,n]]",
    "speeddata": "[n,n,n,n]",
}
"""Format of each data type: b is a Boolean, n a number, t a text."""
_STREAMS = (
    "EGMGetId @",
    "EGMReset @",
    "EGMStreamStop @",
    "EGMStreamStart @ \\ SampleRate := 4",
    'EGMSetupUC ROB_1 , @ , "default" , "rig" \\ Joint',
)
"""Instructions of a stream of joint angles; @ is the egmident."""


def run(text: str, _: str, machine: Machine) -> None:
    if "\r\n" not in text or any(len(line) > 250 for line in text.split("\r\n")):
        raise ProgramError("lines end with CR LF and have 250 characters at most")
    module = _MODULE.fullmatch(_COMMENT.sub(r"\1", text.replace("\r\n", "\n")))
    if not module:
        raise ProgramError("a module needs local data and one procedure")
    name, declarations, procedure, instructions = module.groups()
    if long := re.search(r"\b[A-Za-z]\w{32,}", module[0]):
        raise ProgramError(f"{long[0]} has more than 32 characters")
    data: dict[str, Any] = {}
    for declaration in declarations.split(";")[:-1]:
        declared, value = _declared(declaration.strip())
        if data.setdefault(declared, value) is not value:
            raise ProgramError(f"{declared} is declared twice")
    if procedure in {name, *data}:
        raise ProgramError("a procedure needs a unique name")
    controller = _AbbController(data, machine)
    for instruction in instructions.split(";")[:-1]:
        controller.do(_WORD.findall(instruction))


def _declared(text: str) -> tuple[str, Any]:
    if stream := re.fullmatch(r"LOCAL VAR egmident (\w+)", text):
        return stream[1], "egmident"
    data = _DATA.fullmatch(text)
    if not data:
        raise ProgramError(f"{text!r} is not a declaration")
    kind, name, value = data.groups()
    form = re.sub(r"-?\d+(\.\d+)?(E\d+)?", "n", re.sub("TRUE|FALSE", "b", re.sub(r'"[^"]*"', "t", value)))
    if form != _KINDS.get(kind):
        raise ProgramError(f"{name} is not {kind}: {form}")
    return name, (kind, json.loads(value.replace("TRUE", "true").replace("FALSE", "false")))


class _AbbController:
    def __init__(self, data: dict[str, Any], machine: Machine) -> None:
        self._data, self._machine = data, machine
        self._free_configuration = self._by_path = False
        self._mm_s2 = 0.0

    def do(self, words: list[str]) -> None:
        match words:
            case ["ConfL", "\\", "Off"]:
                self._free_configuration = True
            case ["CirPathMode", "\\", "PathFrame" | "ObjectFrame" as frame]:
                self._by_path = frame == "PathFrame"
            case ["PathAccLim", "TRUE", "\\", "AccMax", ":=", up, ",", "TRUE", "\\", "DecelMax", ":=", down]:
                self._mm_s2 = 1000 * min(float(up), float(down)) if min(float(up), float(down)) >= 0.1 else 0.0
            case ["WaitTime", "\\", "InPos", ",", seconds]:
                self._machine.wait(float(seconds))
            case ["SetDO", signal, ",", "0" | "1" as state]:
                self._machine.events.append(Switched(signal, state == "1"))
            case ["Stop"]:
                self._machine.events.append(OperatorPause())
            case ["MoveAbsJ", target, "\\", "NoEOffs", ",", speed, ",", "fine", ",", *frames]:
                self._frames(frames)
                self._machine.joints(np.radians(self._of(target, "jointtarget")[0]), self._limits(speed))
            case ["MoveL", target, ",", speed, ",", "fine" | "z0" as zone, ",", *frames]:
                self._frames(frames)
                mm_s, stops = self._mm_s(speed), zone == "fine"
                self._machine.line(self._pose(target), mm_s, stops=stops, speed=self._limits(speed))
            case ["MoveC", via, ",", end, ",", speed, ",", "fine" | "z0" as zone, ",", *frames]:
                self._frames(frames)
                turning: Turning = "relative to path" if self._by_path else "even"
                place, at, stops = self._pose(via).place, self._pose(end), zone == "fine"
                limits = self._limits(speed)
                self._machine.arc(place, at, self._mm_s(speed), turning=turning, stops=stops, speed=limits)
            case [name, *_] if name.startswith("EGM"):
                form = " ".join("@" if self._data.get(word) == "egmident" else word for word in words)
                if form not in _STREAMS:
                    raise ProgramError(f"{' '.join(words)} is unknown")
            case _:
                raise ProgramError(f"{' '.join(words)} is not an instruction")

    def _mm_s(self, name: str) -> float:
        return float(self._of(name, "speeddata")[0])

    def _limits(self, name: str) -> MoveLimits:
        mm_s, deg_s, *_ = self._of(name, "speeddata")
        if not (mm_s > 0 and deg_s > 0):
            raise ProgramError(f"{name} is not a speed")
        return MoveLimits(mm_s=mm_s, rad_s=np.radians(deg_s), mm_s2=self._mm_s2)

    def _frames(self, words: list[str]) -> None:
        if len(words) != 5 or words[1:4] != ["\\", "WObj", ":="] or not (self._free_configuration and self._mm_s2):
            raise ProgramError(f"{' '.join(words)}: tool, work object, ConfL and PathAccLim must be set before a move")
        is_held, frame, load = self._of(words[0], "tooldata")
        if not is_held or load[0] <= 0 or not np.any(load[1]):
            raise ProgramError("a tool held by the robot needs a mass and a centre of mass")
        _, _, _, user, thing = self._of(words[4], "wobjdata")
        if [user, thing] != [[[0.0] * 3, [1.0, 0.0, 0.0, 0.0]]] * 2:
            raise ProgramError("this interpreter supports only the base as work object")
        self._machine.tool = _pose(frame)

    def _pose(self, name: str) -> ToolPose:
        return _pose(self._of(name, "robtarget"))

    def _of(self, name: str, kind: str) -> Any:
        if name not in self._data or self._data[name][0] != kind:
            raise ProgramError(f"{name} is not {kind}")
        return self._data[name][1]


def _pose(value: Any) -> ToolPose:
    if abs(np.linalg.norm(value[1]) - 1) > 1e-6:
        raise ProgramError("the length of a quaternion is not 1")
    return ToolPose(np.array(value[0]), Rotation.from_quat(value[1], scalar_first=True))


DRIVER = ProgramDriver(
    run,
    (READING, ControllerParameter("MOTOR_CALIB rob1_{axis} cal_offset", "rad", "reading", -1 / GEAR_RATIO)),
)
