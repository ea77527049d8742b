"""Interpreter of RAPID for emulated controllers: a module with data and one procedure.

Source: ABB, Technical reference manual 3HAC050917. Supported are tooldata, wobjdata, jointtarget in degrees, speeddata,
fine and z0, and robtarget with the quaternion q1 … q4, scalar first. MoveC rotates the tool from start to end relative
to the path, or evenly in space, as set by CirPathMode PathFrame or ObjectFrame. Names have at most 32 characters.
"""

from __future__ import annotations

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
    Tokens,
    ToolPose,
    Turning,
)

_TOKEN = re.compile(
    r"(?P<skip>\s+|![^\n]*)|(?P<number>-?\d+(\.\d+)?(E\d+)?)|(?P<text>\"[^\"]*\")|(?P<name>[A-Za-z]\w*)"
    r"|(?P<mark>:=|[\[\](),;\\])"
)
_KINDS = {
    "tooldata": "bp[n[nnn][nnnn]nnn]",
    "wobjdata": "bbtpp",
    "jointtarget": "[nnnnnn][nnnnnn]",
    "robtarget": "[nnn][nnnn][nnnn][nnnnnn]",
    "speeddata": "nnnn",
}
"""Format of each data type: b is a Boolean, n a number, t a text, p a pose."""
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
    tokens = Tokens.of(text, _TOKEN, "RAPID")
    tokens.take("MODULE")
    module = _name(tokens)
    data: dict[str, Any] = {}
    while tokens.peek()[1] == "LOCAL":
        _declaration(tokens, data)
    tokens.take("PROC")
    if _name(tokens) in {module, *data}:
        raise ProgramError("a procedure needs a unique name")
    tokens.take("(")
    tokens.take(")")
    controller = _AbbController(data, machine)
    while tokens.peek()[1] != "ENDPROC":
        # Name and arguments of an instruction, including switches and optional arguments as written.
        words = [_name(tokens)]
        while tokens.peek()[1] != ";":
            words.append(tokens.take("name", "number", "text", ",", "\\", ":="))
        tokens.take(";")
        controller.do(words)
    tokens.take("ENDPROC")
    tokens.take("ENDMODULE")
    if tokens.peek()[1]:
        raise ProgramError("something follows the module")


def _name(tokens: Tokens) -> str:
    name = tokens.take("name")
    if len(name) > 32:
        raise ProgramError(f"{name} has more than 32 characters")
    return name


def _declaration(tokens: Tokens, data: dict[str, Any]) -> None:
    tokens.take("LOCAL")
    storage = tokens.take("CONST", "PERS", "VAR")
    kind, name = _name(tokens), _name(tokens)
    if name in data:
        raise ProgramError(f"{name} is declared twice")
    if storage == "VAR":
        if kind != "egmident":
            raise ProgramError(f"variables of the kind {kind} are not supported")
        data[name] = kind
    else:
        tokens.take(":=")
        if kind not in _KINDS:
            raise ProgramError(f"data of the kind {kind} are missing")
        value = _value(tokens)
        if _form(value) != f"[{_KINDS[kind].replace('p', '[[nnn][nnnn]]')}]":
            raise ProgramError(f"{name} is not {kind}: {_form(value)}")
        data[name] = (kind, value)
    tokens.take(";")


def _value(tokens: Tokens) -> Any:
    if tokens.peek()[1] == "[":
        tokens.take("[")
        values = [_value(tokens)]
        while tokens.peek()[1] == ",":
            tokens.take(",")
            values.append(_value(tokens))
        tokens.take("]")
        return values
    if tokens.peek()[1] in ("TRUE", "FALSE"):
        return tokens.take("name") == "TRUE"
    text = tokens.take("number", "text")
    return text if text[0] == '"' else float(text)


def _form(value: Any) -> str:
    if isinstance(value, list):
        return f"[{''.join(map(_form, value))}]"
    return {bool: "b", float: "n", str: "t"}[type(value)]


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
