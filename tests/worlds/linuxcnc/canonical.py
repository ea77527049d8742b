"""The interpreter of LinuxCNC itself, rs274, as an oracle for G-code: it shares nothing with rig."""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import dataclass, field
from pathlib import Path

RS274 = shutil.which("rs274")
_CALL = re.compile(r"N(?P<line>\d+|\.+) +(?P<name>[A-Z_0-9]+)\((?P<given>.*)\)")
_MM = {"CANON_UNITS_MM": 1.0, "CANON_UNITS_INCHES": 25.4}


@dataclass(frozen=True)
class Reached:
    """End of a move: X … C in mm and degrees without the offsets, or six joints in the unit of the machine."""

    numbers: tuple[float, ...]
    joints: bool
    turned: bool
    """True if an offset adds to A, B or C, or rotates about Z."""


@dataclass
class _State:
    mm: float = 1.0
    kinematics: float = 0.0
    later: float | None = None
    """Kinematics that M67 selects with the next move; the interpreter has then computed its numbers."""
    g5x: tuple[float, ...] = (0.0,) * 6
    g92: tuple[float, ...] = (0.0,) * 6
    rotation: float = 0.0
    reached: dict[int, Reached] = field(default_factory=dict)


def reached_by(file: Path) -> dict[int, Reached]:
    """Interpret a program, and return the end of the move of each line with an N word, by this word."""
    assert RS274
    variables = file.with_suffix(".var")
    command = [RS274, "-g", "-v", variables.name, file.name]
    done = subprocess.run(command, check=False, cwd=file.parent, capture_output=True, text=True, timeout=30)
    state = _State()
    for call in _CALL.finditer(done.stdout):
        _obey(state, call["line"], call["name"], [word.strip() for word in call["given"].split(",")])
    return state.reached


def _obey(state: _State, line: str, name: str, given: list[str]) -> None:
    match name:
        case "USE_LENGTH_UNITS":
            state.mm = _MM[given[0]]
        case "SET_AUX_OUTPUT_VALUE" if given[0] == "3":
            state.kinematics = float(given[1])
        case "SET_MOTION_OUTPUT_VALUE" if given[0] == "3":
            state.later = float(given[1])
        case "SET_G5X_OFFSET":
            state.g5x = _in_mm(state, given[1:7])
        case "SET_G92_OFFSET":
            state.g92 = _in_mm(state, given[:6])
        case "SET_XY_ROTATION":
            state.rotation = float(given[0])
        case "STRAIGHT_TRAVERSE" | "STRAIGHT_FEED":
            if state.later is not None:
                state.kinematics, state.later = state.later, None
            if line.isdigit():
                state.reached[int(line)] = _end(state, given)


def _in_mm(state: _State, words: list[str]) -> tuple[float, ...]:
    numbers = [float(word) for word in words]
    return (*(state.mm * number for number in numbers[:3]), *numbers[3:])


def _end(state: _State, words: list[str]) -> Reached:
    offsets = [one + other for one, other in zip(state.g5x, state.g92, strict=True)]
    if state.kinematics:
        return Reached(tuple(map(float, words)), True, any(offsets))
    numbers = [number + offset for number, offset in zip(_in_mm(state, words), offsets, strict=True)]
    return Reached(tuple(numbers), False, bool(state.rotation))
