"""Interpreter of INFORM for emulated controllers: Yaskawa jobs (.JBI).

Source: Yaskawa, DX100 Options, data transmission 156191-1CD, chapter 4, and the INFORM manual. Each position belongs to
a single instruction. RCONF applies to the positions that follow. Rx, Ry, Rz rotate about fixed axes in this order.

The arm reaches the first MOVC of a chain on a line. Three are an arc, and each further MOVC continues on the circle of
the last three.
"""

from __future__ import annotations

import math
import re

import numpy as np
from scipy.spatial.transform import Rotation

from analysis.apps.makers.emulated import (
    COUNTS_PER_DEG,
    READING,
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

_HEAD = [
    r"/JOB",
    r"//NAME [A-Z0-9_-]{1,32}",
    r"//POS",
    r"///NPOS (\d+),0,0,0,0,0",
    r"///TOOL \d+",
    r"///POSTYPE BASE",
    r"///RECTAN",
]
_MIDDLE = [
    r"//INST",
    r"///DATE \d{4}/\d\d/\d\d \d\d:\d\d",
    r"///ATTR SC,RW,RJ",
    r"///FRAME BASE",
    r"///GROUP1 RB1",
    r"NOP",
]
_FORM = re.compile(r"///RCONF ([01]),[01],[01],([01]),([01]),([01])(,0){18}")
_POSITION = re.compile(r"C(\d{5})=" + ",".join([r"(-?\d+\.\d{3})"] * 3 + [r"(-?\d+\.\d{4})"] * 3))
_MOVE = re.compile(r"(MOVJ|MOVL|MOVC) C(\d{5}) (?:VJ=(\d+\.\d\d)|V=(\d+\.\d)|VR=(\d+\.\d))( PL=[01])?")


def run(text: str, _: str, machine: Machine) -> None:
    if "\r\n" not in text:
        raise ProgramError("lines end with CR LF")
    *lines, last = text.split("\r\n")
    if last or lines[-1:] != ["END"]:
        raise ProgramError("the job does not end with END")
    heads = [re.fullmatch(form, line) for form, line in zip(_HEAD, lines, strict=False)]
    if len(heads) < len(_HEAD) or not all(heads):
        raise ProgramError("the header of the job is out of order")
    count = int(heads[3][1])  # type: ignore[index]
    positions, instructions = _positions(lines[len(_HEAD) :])
    if len(positions) != count:
        raise ProgramError(f"{len(positions)} positions, but NPOS is {count}")
    if not all(re.fullmatch(form, line) for form, line in zip(_MIDDLE, instructions, strict=False)):
        raise ProgramError("the instructions start out of order")
    _YaskawaController(positions, machine).obey(instructions[len(_MIDDLE) : -1])


def _positions(lines: list[str]) -> tuple[list[ToolPose], list[str]]:
    positions: list[ToolPose] = []
    configuration = None
    for number, line in enumerate(lines):
        if match := _POSITION.fullmatch(line):
            if int(match[1]) != len(positions) or configuration is None:
                raise ProgramError(f"{line!r} is out of order, or has no RCONF")
            values = [float(value) for value in match.groups()[1:]]
            turn = Rotation.from_euler("xyz", values[3:], degrees=True)
            positions.append(ToolPose(np.array(values[:3]), turn, configuration))
        elif match := _FORM.fullmatch(line):
            configuration = ConfigurationFlags(match[1] == "0", tuple(map(int, match.groups()[1:4])))
        else:
            return positions, lines[number:]
    return positions, []


class _YaskawaController:
    def __init__(self, positions: list[ToolPose], machine: Machine) -> None:
        self._positions, self._machine = positions, machine
        self._used: set[int] = set()

    def obey(self, lines: list[str]) -> None:
        chain: list[tuple[ToolPose, float, bool]] = []
        for line in lines:
            match = _MOVE.fullmatch(line)
            if match and match[1] == "MOVC":
                chain.append((self._take(match[2]), self._speed(match[4]), match[6] == " PL=0"))
                continue
            if match or line.startswith(("TIMER", "DOUT", "PAUSE")):
                self._drive(chain)
                chain = []
            if match:
                self._move(match)
            elif line.startswith("'"):
                if len(line) > 1 + 32:
                    raise ProgramError(f"the comment {line!r} is longer than 32 characters")
            elif match := re.fullmatch(r"TIMER T=(\d+\.\d\d)", line):
                self._machine.wait(float(match[1]))
            elif match := re.fullmatch(r"DOUT OT#\((\d+)\) (ON|OFF)", line):
                self._machine.events.append(Switched(int(match[1]), match[2] == "ON"))
            elif line == "PAUSE":
                self._machine.events.append(OperatorPause())
            else:
                raise ProgramError(f"{line!r} is not an instruction")
        self._drive(chain)
        if len(self._used) != len(self._positions):
            raise ProgramError("a position of the job belongs to no instruction")

    def _move(self, match: re.Match[str]) -> None:
        pose = self._take(match[2])
        if match[1] == "MOVJ":
            if not match[3] or not 0 < float(match[3]) <= 100:
                raise ProgramError("a joint move needs a speed VJ in percent")
            self._machine.go(pose, MoveLimits(share=float(match[3]) / 100))
        elif match[5]:
            self._machine.turn(pose, np.radians(float(match[5])))
        else:
            self._machine.line(pose, self._speed(match[4]), stops=match[6] == " PL=0")

    def _drive(self, chain: list[tuple[ToolPose, float, bool]]) -> None:
        if not chain:
            return
        if len(chain) < 3:
            raise ProgramError("an arc needs three MOVC")
        self._machine.line(chain[0][0], chain[0][1], stops=chain[0][2])
        for number in range(1, len(chain) - 1, 2):
            via, (end, speed, stops) = chain[number][0], chain[number + 1]
            self._machine.arc(via.place, end, speed, turning="even", stops=stops)
        if len(chain) % 2 == 0:
            raise ProgramError("this interpreter supports only complete arcs")

    def _take(self, number: str) -> ToolPose:
        if int(number) in self._used or int(number) >= len(self._positions):
            raise ProgramError(f"C{number} is missing, or used twice")
        self._used.add(int(number))
        return self._positions[int(number)]

    @staticmethod
    def _speed(text: str | None) -> float:
        if text is None:
            raise ProgramError("a path needs a speed V in mm/s")
        return float(text)


DRIVER = ProgramDriver(
    run,
    (
        READING,
        ControllerParameter(
            "home position (ABSO data) of axis {axis}", "pulses", "reading", -math.radians(1) / COUNTS_PER_DEG
        ),
    ),
    tool_entered=True,
)
