"""URScript: one function and its call. Universal Robots, Script Manual: a pose p[x, y, z, rx, ry, rz] has metres and a
rotation vector in radians; movec in mode 1 keeps the orientation fixed to the tangent of the arc, and then only the
position of pose_to is used."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from analysis.emulation.machine import Held, Machine, Pose, ProgramError, Shown, Speed, Switched, Turning

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
"""The number of the first as RTDE counts them, and how many there are."""


@dataclass
class _Tokens:
    items: list[tuple[str, str]]
    at: int = 0

    def peek(self) -> tuple[str, str]:
        return self.items[self.at] if self.at < len(self.items) else ("over", "")

    def take(self, *wanted: str) -> str:
        kind, text = self.peek()
        if kind not in wanted and text not in wanted:
            raise ProgramError(f"{text!r} stands where {' or '.join(wanted)} is expected")
        self.at += 1
        return text

    def blank(self) -> None:
        while self.peek()[0] == "end":
            self.at += 1


def _tokens(text: str) -> Iterator[tuple[str, str]]:
    at = 0
    while at < len(text):
        found = _TOKEN.match(text, at)
        if not found:
            raise ProgramError(f"{text[at : at + 20]!r} is not URScript")
        if found.lastgroup != "skip":
            yield str(found.lastgroup), found[0]
        at = found.end()


@dataclass
class _Call:
    name: str
    arguments: dict[str, Any] = field(default_factory=dict)


def run(text: str, machine: Machine) -> None:
    """Drive the machine with a script. Raises ProgramError for one that is refused."""
    tokens = _Tokens(list(_tokens(text)))
    tokens.blank()
    tokens.take("def")
    name = tokens.take("name")
    for mark in ("(", ")", ":"):
        tokens.take(mark)
    tokens.take("end")
    calls = []
    while True:
        tokens.blank()
        if tokens.peek() == ("name", "end"):
            break
        calls.append(_call(tokens))
        if tokens.take("end") != "\n":
            raise ProgramError("a statement ends with its line")
    tokens.take("name")
    tokens.blank()
    if tokens.take("name") != name:
        raise ProgramError("the function is not called")
    for mark in ("(", ")"):
        tokens.take(mark)
    tokens.blank()
    if tokens.peek()[0] != "over":
        raise ProgramError("something follows the program")
    for call in calls:
        _do(call, machine)


def _call(tokens: _Tokens) -> _Call:
    call = _Call(tokens.take("name"))
    if call.name not in _PARAMETERS:
        raise ProgramError(f"{call.name} is not known")
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
            raise ProgramError(f"{call.name} has no parameter {key!r} left")
        call.arguments[key] = _value(tokens)
    tokens.take(")")
    return call


def _value(tokens: _Tokens) -> Any:
    kind, _ = tokens.peek()
    if kind in ("pose", "mark"):
        tokens.take("pose", "[")
        values = [float(tokens.take("number"))]
        while tokens.peek()[1] == ",":
            tokens.take(",")
            values.append(float(tokens.take("number")))
        tokens.take("]")
        if len(values) != 6:
            raise ProgramError(f"{len(values)} numbers where six are expected")
        return _pose(values) if kind == "pose" else np.array(values)
    if kind == "name":
        return {"True": True, "False": False}[tokens.take("True", "False")]
    return tokens.take("number", "text").strip('"') if kind == "text" else float(tokens.take("number"))


def _pose(values: list[float]) -> Pose:
    return Pose(1000 * np.array(values[:3]), Rotation.from_rotvec(values[3:]))


def _do(call: _Call, machine: Machine) -> None:
    given = call.arguments
    match call.name:
        case "set_tcp":
            machine.tool = given["pose"]
        case "movej":
            speed = Speed(axis_rad_s=_above_0(given.get("v", 1.05)), axis_rad_s2=_above_0(given.get("a", 1.4)))
            machine.joints(given["q"], replace(speed, seconds=given.get("t") or None))
        case "movel":
            speed_mm_s = 1000 * given.get("v", 0.25)
            machine.line(given["pose"], speed_mm_s, stops=not given.get("r", 0.0), speed=_on_path(given))
        case "movec":
            turning: Turning = "fixed to path" if given.get("mode", 0.0) == 1 else "even"
            stops = not given.get("r", 0.0)
            speed_mm_s, via = 1000 * given.get("v", 0.25), given["pose_via"].place
            machine.arc(via, given["pose_to"], speed_mm_s, turning=turning, stops=stops, speed=_on_path(given))
        case "sleep":
            machine.wait(given["t"])
        case "popup":
            if given.get("blocking"):
                machine.events.append(Held())
        case "write_output_integer_register":
            machine.events.append(Shown(int(given["address"]), int(given["value"])))
        case name:
            first, count = _OUTPUTS[name]
            if not 0 <= given["n"] < count:
                raise ProgramError(f"{name} has no output {given['n']}")
            machine.events.append(Switched(first + int(given["n"]), given["b"]))


def _on_path(given: dict[str, Any]) -> Speed:
    """The manual's default of an acceleration is 1.2 m/s²; with t the time decides."""
    return Speed(mm_s2=1000 * _above_0(given.get("a", 1.2)), seconds=given.get("t") or None)


def _above_0(value: float) -> float:
    if not 0 < value < np.inf:
        raise ProgramError(f"{value} is no speed and no acceleration")
    return value
