"""Interpreter of KRL for emulated controllers: a .src file with the .dat file of the same name.

Source: KUKA System Software 8.x. A, B, C rotate about z, then the new y, then the new x. With $CIRC_TYPE = #PATH and
$ORI_TYPE = #VAR the tool rotates from start to end relative to the path, with #BASE evenly in space. $BASE refers to
$WORLD, so points in the robot's base frame need $BASE = $ROBROOT.
"""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from analysis.apps.makers.emulated import (
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

_WORD = re.compile(r"-?\d+(?:\.\d+)?|\"[^\"]*\"|#[A-Z]+|[$A-Za-z_][\w$]*(?:\.CP|\.CDIS|\.ORI[12])?|<>|\S")
_SETTINGS = {"$TOOL", "$BASE", "$VEL.CP", "$VEL.ORI1", "$VEL.ORI2", "$ACC.CP", "$APO.CDIS", "$ORI_TYPE", "$CIRC_TYPE"}
_CALLS = {"BAS": ["#INITMOV", ",", "0"], "RSI_ON": ["#RELATIVE"], "RSI_OFF": []}


def run(source: str, data: str, machine: Machine) -> None:
    if not data:
        raise ProgramError("the data list (the .dat file of the same name) is missing")
    name, statements = _inside(source, "DEF", "END", r"(\w+)\(\)")
    listed, declarations = _inside(data, "DEFDAT", "ENDDAT", r"(\w+)")
    if name != listed:
        raise ProgramError(f"the data list of {name} is called {listed}")
    _KukaController(_points(declarations), machine).obey(statements)


def _inside(text: str, opening: str, closing: str, form: str) -> tuple[str, list[list[str]]]:
    if "\r\n" not in text:
        raise ProgramError("lines end with CR LF")
    lines = [line.split(";")[0].strip() for line in text.replace("\r\n", "\n").split("\n")]
    filled = [line for line in lines if line]
    head = re.fullmatch(rf"{opening} {form}", filled[1]) if len(filled) > 2 else None
    if head is None or filled[0] != "&ACCESS RVP" or filled[-1] != closing:
        raise ProgramError(f"no {opening} … {closing}")
    _check_name(head[1])
    return head[1], [_WORD.findall(line) for line in filled[2:-1]]


def _check_name(name: str) -> str:
    if not re.fullmatch(r"[A-Za-z_]\w{0,23}", name):
        raise ProgramError(f"{name!r} is not a name of at most 24 characters")
    return name


def _points(declarations: list[list[str]]) -> dict[str, Any]:
    points: dict[str, Any] = {}
    for tokens in declarations:
        match tokens:
            case ["DECL", "E6AXIS" | "FRAME" as kind, name, "=", *aggregate] if _check_name(name) not in points:
                axes = [f"{letter}{axis}" for letter in "AE" for axis in range(1, 7)]
                is_pose = kind == "FRAME"
                points[name] = _frame(aggregate) if is_pose else np.radians(_aggregate(aggregate, axes)[:6])
            case _:
                raise ProgramError(f"{' '.join(tokens)!r} is not a new point")
    return points


def _aggregate(tokens: list[str], names: list[str]) -> list[float]:
    expected = "{" + ",".join(f"{name} @" for name in names) + "}"
    form = re.sub(r" , ", ",", " ".join("@" if re.fullmatch(r"-?\d+\.\d+", token) else token for token in tokens))
    if form.replace("{ ", "{").replace(" }", "}") != expected:
        raise ProgramError(f"{' '.join(tokens)!r} is not {expected}")
    return [float(token) for token in tokens if re.fullmatch(r"-?\d+\.\d+", token)]


def _frame(tokens: list[str]) -> ToolPose:
    values = _aggregate(tokens, list("XYZABC"))
    return ToolPose(np.array(values[:3]), Rotation.from_euler("ZYX", values[3:], degrees=True))


class _KukaController:
    def __init__(self, points: dict[str, Any], machine: Machine) -> None:
        self._points, self._machine = points, machine
        self._settings: dict[str, Any] = {}
        self._axis_speeds: dict[int, int] = {}
        self._variables: set[str] = set()
        self._opened = 0
        self._declaring = True

    def obey(self, statements: list[list[str]]) -> None:
        for tokens in statements:
            if tokens[:2] == ["DECL", "INT"] and len(tokens) == 3 and self._declaring:
                self._variables.add(_check_name(tokens[2]))
                continue
            self._declaring = False
            match tokens:
                case ["PTP", name] if isinstance(self._at(name), np.ndarray) and len(self._axis_speeds) == 6:
                    self._machine.joints(self._at(name), MoveLimits(share=min(self._axis_speeds.values()) / 100))
                case ["LIN", name, *zone] if isinstance(self._at(name), ToolPose) and zone in ([], ["C_DIS"]):
                    stops = not (zone and self._settings["$APO.CDIS"] > 0)
                    self._machine.line(self._at(name), self._speed_mm_s(), stops=stops, speed=self._limits())
                case ["CIRC", via, ",", end, *zone] if zone in ([], ["C_DIS"]):
                    related = self._settings["$CIRC_TYPE"] == "#PATH" and self._settings["$ORI_TYPE"] == "#VAR"
                    turning: Turning = "relative to path" if related else "even"
                    stops = not (zone and self._settings["$APO.CDIS"] > 0)
                    place, target, mm_s = self._at(via).place, self._at(end), self._speed_mm_s()
                    self._machine.arc(place, target, mm_s, turning=turning, stops=stops, speed=self._limits())
                case _:
                    self._act(tokens)
        if self._opened:
            raise ProgramError("an IF has no ENDIF")

    def _at(self, name: str) -> Any:
        if name not in self._points:
            raise ProgramError(f"the point {name} is not declared")
        return self._points[name]

    def _speed_mm_s(self) -> float:
        if self._settings.get("$BASE") != "$ROBROOT" or self._settings["$ACC.CP"] <= 0:
            raise ProgramError("a path needs a base and an acceleration")
        return 1000 * float(self._settings["$VEL.CP"])

    def _limits(self) -> MoveLimits:
        turning = self._settings.get("$VEL.ORI1")
        return MoveLimits(mm_s2=1000 * self._settings["$ACC.CP"], rad_s=turning and np.radians(turning))

    def _act(self, tokens: list[str]) -> None:
        match tokens:
            case ["$TOOL", "=", *aggregate]:
                self._machine.tool = _frame(aggregate)
            case ["$VEL_AXIS", "[", axis, "]", "=", percent] if 1 <= int(percent) <= 100:
                self._axis_speeds[int(axis)] = int(percent)
            case [name, "=", value] if name in _SETTINGS:
                self._settings[name] = value if value[0] in "#$" else float(value)
            case [name, "=", call, "(", *arguments, ")"] if name in self._variables and call.startswith("RSI_"):
                self._call(call, arguments)
            case ["WAIT", "SEC", seconds]:
                self._machine.wait(float(seconds))
            case ["$OUT", "[", number, "]", "=", "TRUE" | "FALSE" as state]:
                self._machine.events.append(Switched(int(number), state == "TRUE"))
            case ["HALT"]:
                if not self._opened:  # The IF handles a failed RSI call, and RSI calls never fail here.
                    self._machine.events.append(OperatorPause())
            case ["IF", "(", name, "<>", "RSIOK", ")", "THEN"] if name in self._variables:
                self._opened += 1
            case ["ENDIF"] if self._opened:
                self._opened -= 1
            case ["BAS", "(", *arguments, ")"]:
                self._call("BAS", arguments)
            case _:
                raise ProgramError(f"{' '.join(tokens)!r} is not an instruction")

    def _call(self, name: str, arguments: list[str]) -> None:
        if name == "RSI_CREATE":
            match arguments:
                case [context, ",", variable, ",", "TRUE"] if context[0] == '"' and variable in self._variables:
                    return
        elif _CALLS.get(name) == arguments:
            return
        raise ProgramError(f"{name}({' '.join(arguments)}) is unknown")


DRIVER = ProgramDriver(
    run,
    (
        ControllerParameter("$MAMES[{axis}]", "deg", "reading", math.radians(1)),
        ControllerParameter("$LENGTH_A", "mm", "a", 1.0, axis=2, grows=True),
        ControllerParameter("$LENGTH_B", "mm", "a", 1.0, axis=3, grows=True),
        ControllerParameter("height in $TX3P3", "mm", "a", 1.0, axis=4, grows=True),
        ControllerParameter("length in $TX3P3", "mm", "d", 1.0, axis=4, grows=True),
        ControllerParameter("length in $TFLWP", "mm", "d", 1.0, axis=6, grows=True),
    ),
)
