"""Interpreter of G-code for emulated controllers: LinuxCNC with genserkins.

Source: LinuxCNC 2.9, G-code reference and Switchable Kinematics. Moves have all six numbers, in inverse time (G93). In
the second kinematics (analog output 3) X … C are joint angles in degrees. A, B, C are roll, pitch and yaw in degrees
and change evenly along a move; A, B, C of an offset are whole turns. The pose is that of the flange.
"""

from __future__ import annotations

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
    RegisterOutput,
    Switched,
    ToolPose,
    Turning,
)

_COMMENT = re.compile(r";.*|\(.*?\)")
_WORD = re.compile(r"([A-Z])(-?\d+(?:\.\d*)?)")
_COMPUTED = re.compile(r"\[[^\n]*?\](?=\s[A-Z]|$)")
"""An expression as the value of a word. It depends on the state of the real machine, which is ideal here."""
_CONDITION = re.compile(r"o(\d+) if \[.*\]")
_LETTERS = "XYZABC"
_PLANES = {"G17": (0, 1, "I", "J"), "G18": (2, 0, "K", "I"), "G19": (1, 2, "J", "K")}
_PREPARATION = {"G21", "G90", "G40", "G49", "G80", "G93", "G94", "G92.1", "G20", "G59.3"}
_SAME_RAD = 1e-6
_LEAST_MM_S = 0.1
"""Speed of a move with a duration but no length, which the machine of the emulation cannot express."""


def run(text: str, _: str, machine: Machine) -> None:
    controller = _LinuxCNC(machine)
    lines = [_COMMENT.sub("", line).strip() for line in text.split("\n")]
    skipping = ""
    for line in filter(None, lines):
        if condition := _CONDITION.fullmatch(line):
            skipping = condition[1]  # the emulated arm stands where the program expects it
        elif line == f"o{skipping} endif":
            skipping = ""
        elif not skipping:
            if controller.over:
                raise ProgramError("something follows M2")
            controller.obey(line)
    if not controller.over:
        raise ProgramError("the program does not end with M2")


class _LinuxCNC:
    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._plane = "G17"
        self._stops = False
        self._joints = False
        self._modes: set[str] = set()
        self.over = False

    def obey(self, line: str) -> None:
        words = [(letter, float(number)) for letter, number in _WORD.findall(_COMPUTED.sub("1", line))]
        if _WORD.sub("", _COMPUTED.sub("1", line)).strip():
            raise ProgramError(f"{line[:40]!r} is not G-code")
        codes = [f"{letter}{number:g}" for letter, number in words if letter in "GM"]
        values = {letter: number for letter, number in words if letter not in "GM"}
        for code in codes:
            self._do(code, values)

    def _do(self, code: str, values: dict[str, float]) -> None:
        match code:
            case "G1":
                self._straight(values)
            case "G2" | "G3":
                self._arc(values, 1.0 if code == "G3" else -1.0)
            case "G10":
                if values["L"] != 2 or values["P"] != 9 or any(values[letter] for letter in "XYZR"):
                    raise ProgramError("this interpreter supports only offsets of whole turns, of G59.3")
            case "G61.1" | "G64":
                self._stops = code == "G61.1"
            case "G17" | "G18" | "G19":
                self._plane = code
            case "M68" if values["E"] == 3:
                self._joints = bool(values["Q"])
            case "M2":
                self.over = True
            case _ if code in _PREPARATION:
                self._modes.add(code)
            case _:
                self._act(code, values)

    def _act(self, code: str, values: dict[str, float]) -> None:
        match code:
            case "G4":
                self._machine.wait(values["P"])
            case "M0":
                self._machine.events.append(OperatorPause())
            case "M64" | "M65":
                self._machine.events.append(Switched(int(values["P"]), code == "M64"))
            case "M68":
                self._machine.events.append(RegisterOutput(int(values["E"]), int(values["Q"])))
            case "M66":
                pass
            case _:
                raise ProgramError(f"{code} is unknown")

    def _numbers(self, values: dict[str, float]) -> Array:
        if not {"G21", "G90", "G93", "G59.3", "G49", "G92.1"} <= self._modes:
            raise ProgramError("the program moves before selecting units, distances, feed and offsets")
        if values.get("F", 0.0) <= 0:
            raise ProgramError("a move in inverse time needs F")
        return np.array([values[letter] for letter in _LETTERS])

    def _pose(self, numbers: Array) -> ToolPose:
        tool, turn = self._machine.tool, Rotation.from_euler("xyz", numbers[3:], degrees=True)
        return ToolPose(numbers[:3] + turn.apply(tool.place), turn * tool.turn)

    def _straight(self, values: dict[str, float]) -> None:
        numbers, seconds = self._numbers(values), 60 / values["F"]
        if self._joints:
            self._machine.joints(np.radians(numbers), MoveLimits(seconds=seconds))
            return
        end = self._pose(numbers)
        length = float(np.linalg.norm(end.place - self._machine.pose.place))
        speed = max(length / seconds, _LEAST_MM_S)
        self._machine.line(end, speed, stops=self._stops, speed=MoveLimits(seconds=seconds))

    def _arc(self, values: dict[str, float], sense: float) -> None:
        """Move the flange on an arc, with an even change of A, B and C, as an arc of the tool."""
        numbers, seconds = self._numbers(values), 60 / values["F"]
        first, second, *letters = _PLANES[self._plane]
        machine, tool = self._machine, self._machine.tool
        turn = machine.pose.turn * tool.turn.inv()
        flange = machine.pose.place - turn.apply(tool.place)
        middle = np.array([flange[first] + values[letters[0]], flange[second] + values[letters[1]]])
        begin, end = flange[[first, second]] - middle, numbers[[first, second]] - middle
        if abs(np.linalg.norm(begin) - np.linalg.norm(end)) > 1e-3:
            raise ProgramError("the ends of an arc have different distances from the centre")
        angle = float(np.arctan2(begin[0] * end[1] - begin[1] * end[0], begin @ end) * sense % (2 * np.pi)) * sense
        axis = np.zeros(3)
        axis[3 - first - second] = 1.0
        follows = Rotation.from_rotvec(angle * axis)
        target = self._pose(numbers)
        turned = target.turn * machine.pose.turn.inv()
        if min((turned * follows.inv()).magnitude(), turned.magnitude()) > _SAME_RAD:
            raise ProgramError("this interpreter supports only arcs along which the tool keeps or follows the tangent")
        centre = flange.copy()
        centre[[first, second]] = middle
        if turned.magnitude() < _SAME_RAD:  # the tool moves as the flange, about a shifted centre
            centre += machine.pose.place - flange
        away = machine.pose.place - centre
        via = centre + Rotation.from_rotvec(angle / 2 * axis).apply(away)
        turning: Turning = "even" if turned.magnitude() < _SAME_RAD else "fixed to path"
        speed = abs(angle) * float(np.linalg.norm(np.cross(axis, away))) / seconds
        machine.arc(via, target, speed, turning=turning, stops=self._stops)


DRIVER = ProgramDriver(
    run,
    (
        ControllerParameter("HOME_OFFSET of [JOINT_{axis}]", "deg", "reading", np.radians(1), later=1),
        ControllerParameter("genserkins.A-{axis}", "mm", "a", 1.0, later=1),
        ControllerParameter("genserkins.ALPHA-{axis}", "rad", "alpha", 1.0, later=1),
        ControllerParameter("genserkins.D-{axis}", "mm", "d", 1.0, later=1),
    ),
    tool_entered=True,
)
"""A joint reads the angle of its motor plus HOME_OFFSET."""
