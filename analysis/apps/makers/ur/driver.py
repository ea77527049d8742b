"""Interpreter of URScript for emulated controllers: a function and the call of it.

Source: Universal Robots, Script Manual. A pose p[x, y, z, rx, ry, rz] consists of metres and a rotation vector in
radians. movec in mode 1 keeps the orientation fixed to the tangent of the arc, and uses only the position of pose_to.
"""

from __future__ import annotations

import ast
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
    RegisterOutput,
    Switched,
    ToolPose,
    Turning,
)

_PROGRAM = re.compile(r"(?:#[^\n]*\n|\s)*def (\w+)\(\):\n(.*)\nend\n(\w+)\(\)\s*", re.DOTALL)
_POSE = re.compile(r"\bp\[([^\[\]]*)\]")


def run(text: str, _: str, machine: Machine) -> None:
    program = _PROGRAM.fullmatch(text)
    if not program or program[1] != program[3]:
        raise ProgramError("the script is not a function and the call of it")
    functions = _Functions(machine)
    for line in filter(None, map(str.strip, program[2].split("\n"))):
        if not line.startswith("#"):
            _call(line, functions)


def _call(line: str, functions: _Functions) -> None:
    """Call a function. The syntax is that of Python, except for poses."""
    try:
        call = ast.parse(_POSE.sub(r"p(\1)", line), mode="eval").body
    except SyntaxError as error:
        raise ProgramError(f"{line!r} is not URScript") from error
    match call:
        case ast.Call(ast.Name(name), arguments, keywords) if not name.startswith("_") and hasattr(functions, name):
            named = {str(keyword.arg): _value(keyword.value) for keyword in keywords}
            getattr(functions, name)(*map(_value, arguments), **named)
        case _:
            raise ProgramError(f"{line!r} is not a call of a known function")


def _value(node: ast.expr) -> Any:
    match node:
        case ast.Call(ast.Name("p"), numbers, []) if len(numbers) == 6:
            values = np.array([ast.literal_eval(number) for number in numbers])
            return ToolPose(1000 * values[:3], Rotation.from_rotvec(values[3:]))
    return ast.literal_eval(node)


class _Functions:
    def __init__(self, machine: Machine) -> None:
        self._machine = machine

    def set_tcp(self, pose: ToolPose) -> None:
        self._machine.tool = pose

    def movej(self, q: list[float], a: float = 1.4, v: float = 1.05, t: float = 0.0, r: float = 0.0) -> None:
        speed = MoveLimits(axis_rad_s=_above_0(v), axis_rad_s2=_above_0(a), seconds=t or None)
        self._machine.joints(np.array(q), speed)

    def movel(self, pose: ToolPose, a: float = 1.2, v: float = 0.25, t: float = 0.0, r: float = 0.0) -> None:
        """The argument t overrides speed and acceleration."""
        speed = MoveLimits(mm_s2=1000 * _above_0(a), seconds=t or None)
        self._machine.line(pose, 1000 * v, stops=not r, speed=speed)

    def movec(
        self, pose_via: ToolPose, pose_to: ToolPose, a: float = 1.2, v: float = 0.25, r: float = 0.0, mode: int = 0
    ) -> None:
        turning: Turning = "fixed to path" if mode == 1 else "even"
        speed = MoveLimits(mm_s2=1000 * _above_0(a))
        self._machine.arc(pose_via.place, pose_to, 1000 * v, turning=turning, stops=not r, speed=speed)

    def sleep(self, t: float) -> None:
        self._machine.wait(t)

    def popup(
        self, s: str, title: str = "", warning: bool = False, error: bool = False, blocking: bool = False
    ) -> None:
        if blocking:
            self._machine.events.append(OperatorPause())

    def set_standard_digital_out(self, n: int, b: bool) -> None:
        self._switch(range(8), n, b)

    def set_configurable_digital_out(self, n: int, b: bool) -> None:
        self._switch(range(8, 16), n, b)

    def set_tool_digital_out(self, n: int, b: bool) -> None:
        self._switch(range(16, 18), n, b)

    def _switch(self, outputs: range, n: int, on: bool) -> None:
        """outputs: numbers in RTDE."""
        if not 0 <= n < len(outputs):
            raise ProgramError(f"there is no output {n}")
        self._machine.events.append(Switched(outputs[n], on))

    def write_output_integer_register(self, address: int, value: int) -> None:
        self._machine.events.append(RegisterOutput(address, value))


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
