"""Interpreter of URScript for emulated controllers: a function and the call of it.

Source: Universal Robots, Script Manual. A pose p[x, y, z, rx, ry, rz] consists of metres and a rotation vector in
radians. movec in mode 1 keeps the orientation fixed to the tangent of the arc, and uses only the position of pose_to.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
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
    RegisterOutput,
    Switched,
    Tokens,
    ToolPose,
    Turning,
)

_TOKEN = re.compile(
    r'(?P<skip>[ \t]+|#[^\n]*)|(?P<end>\n)|(?P<number>-?\d+(\.\d+)?)|(?P<text>"[^"\n]*")|(?P<pose>p\[)'
    r"|(?P<name>[A-Za-z_]\w*)|(?P<mark>[\[\](),=:])"
)
_PARAMETERS = {
    "set_tcp": ("pose",),
    "movej": ("q", "a", "v", "t", "r"),
    "movel": ("pose", "a", "v", "t", "r"),
    "movec": ("pose_via", "pose_to", "a", "v", "r", "mode"),
    "sleep": ("t",),
    "popup": ("s", "title", "warning", "error", "blocking"),
    "set_standard_digital_out": ("n", "b"),
    "set_configurable_digital_out": ("n", "b"),
    "set_tool_digital_out": ("n", "b"),
    "write_output_integer_register": ("address", "value"),
}
_OUTPUTS = {"set_standard_digital_out": (0, 8), "set_configurable_digital_out": (8, 8), "set_tool_digital_out": (16, 2)}
"""For each function: number of the first output in RTDE, and number of outputs."""


@dataclass
class _Call:
    name: str
    arguments: dict[str, Any] = field(default_factory=dict)


def run(text: str, _: str, machine: Machine) -> None:
    tokens = Tokens.of(text, _TOKEN, "URScript")
    _blank(tokens)
    tokens.take("def")
    name = tokens.take("name")
    for mark in ("(", ")", ":"):
        tokens.take(mark)
    tokens.take("end")
    calls = []
    while True:
        _blank(tokens)
        if tokens.peek() == ("name", "end"):
            break
        calls.append(_call(tokens))
        if tokens.take("end") != "\n":
            raise ProgramError("unexpected text after the statement; write one statement per line")
    tokens.take("name")
    _blank(tokens)
    if tokens.take("name") != name:
        raise ProgramError("the function is not called")
    for mark in ("(", ")"):
        tokens.take(mark)
    _blank(tokens)
    if tokens.peek()[0] != "over":
        raise ProgramError("something follows the program")
    for call in calls:
        _do(call, machine)


def _blank(tokens: Tokens) -> None:
    while tokens.peek()[0] == "end":
        tokens.at += 1


def _call(tokens: Tokens) -> _Call:
    call = _Call(tokens.take("name"))
    if call.name not in _PARAMETERS:
        raise ProgramError(f"{call.name} is unknown")
    names = _PARAMETERS[call.name]
    tokens.take("(")
    while tokens.peek()[1] != ")":
        if call.arguments:
            tokens.take(",")
        key = names[len(call.arguments)] if len(call.arguments) < len(names) else ""
        if tokens.peek()[0] == "name" and tokens.items[tokens.at + 1][1] == "=":
            key = tokens.take("name")
            tokens.take("=")
        if key not in names or key in call.arguments:
            raise ProgramError(f"{call.name} has no further parameter {key!r}")
        call.arguments[key] = _value(tokens)
    tokens.take(")")
    return call


def _value(tokens: Tokens) -> Any:
    kind, _ = tokens.peek()
    if kind in ("pose", "mark"):
        tokens.take("pose", "[")
        values = [float(tokens.take("number"))]
        while tokens.peek()[1] == ",":
            tokens.take(",")
            values.append(float(tokens.take("number")))
        tokens.take("]")
        if len(values) != 6:
            raise ProgramError(f"{len(values)} numbers instead of six")
        return (
            ToolPose(1000 * np.array(values[:3]), Rotation.from_rotvec(values[3:]))
            if kind == "pose"
            else np.array(values)
        )
    if kind == "name":
        return {"True": True, "False": False}[tokens.take("True", "False")]
    return tokens.take("number", "text").strip('"') if kind == "text" else float(tokens.take("number"))


def _do(call: _Call, machine: Machine) -> None:
    arguments = call.arguments
    match call.name:
        case "set_tcp":
            machine.tool = arguments["pose"]
        case "movej":
            speed = MoveLimits(
                axis_rad_s=_above_0(arguments.get("v", 1.05)), axis_rad_s2=_above_0(arguments.get("a", 1.4))
            )
            machine.joints(arguments["q"], replace(speed, seconds=arguments.get("t") or None))
        case "movel":
            speed_mm_s = 1000 * arguments.get("v", 0.25)
            machine.line(
                _pose_in(arguments, "pose"), speed_mm_s, stops=not arguments.get("r", 0.0), speed=_on_path(arguments)
            )
        case "movec":
            turning: Turning = "fixed to path" if arguments.get("mode", 0.0) == 1 else "even"
            stops = not arguments.get("r", 0.0)
            speed_mm_s, via = 1000 * arguments.get("v", 0.25), _pose_in(arguments, "pose_via").place
            end, limits = _pose_in(arguments, "pose_to"), _on_path(arguments)
            machine.arc(via, end, speed_mm_s, turning=turning, stops=stops, speed=limits)
        case "sleep":
            machine.wait(arguments["t"])
        case "popup":
            if arguments.get("blocking"):
                machine.events.append(OperatorPause())
        case "write_output_integer_register":
            machine.events.append(RegisterOutput(int(arguments["address"]), int(arguments["value"])))
        case name:
            first, count = _OUTPUTS[name]
            if not 0 <= arguments["n"] < count:
                raise ProgramError(f"{name} has no output {arguments['n']}")
            machine.events.append(Switched(first + int(arguments["n"]), arguments["b"]))


def _pose_in(arguments: dict[str, Any], name: str) -> ToolPose:
    if not isinstance(arguments[name], ToolPose):
        raise ProgramError(f"{name} has joint angles; the emulated controller takes only poses there")
    pose: ToolPose = arguments[name]
    return pose


def _on_path(arguments: dict[str, Any]) -> MoveLimits:
    """The default acceleration of the manual is 1.2 m/s². The argument t overrides speed and acceleration."""
    return MoveLimits(mm_s2=1000 * _above_0(arguments.get("a", 1.2)), seconds=arguments.get("t") or None)


def _above_0(value: float) -> float:
    if not 0 < value < np.inf:
        raise ProgramError(f"{value} is not a valid speed or acceleration")
    return value


DRIVER = ProgramDriver(
    run,
    (
        ControllerParameter("delta_theta[{axis}]", "rad", "offset", 1.0),
        ControllerParameter("delta_a[{axis}]", "m", "a", 1e3, later=1),
        ControllerParameter("delta_alpha[{axis}]", "rad", "alpha", 1.0, later=1),
        ControllerParameter("delta_d[{axis}]", "m", "d", 1e3),
    ),
)
"""delta_theta, delta_a, delta_d and delta_alpha are added to the constants; the reading does not change."""
