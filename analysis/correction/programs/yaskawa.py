"""Targets in a Yaskawa job (.JBI): positions in pulses, or in mm and degrees with their posture (RCONF).

Source: Yaskawa, DX100 Options, Instructions for data transmission (156191-1CD), chapter 4. BASE and ROBOT count in the
robot's base, since positions of a base axis are left; USER n is a frame that a person states. IMOV is relative, and
between SFTON and SFTOF every position is shifted. P variables belong to the controller.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from analysis.correction.programs.numbers import Decimals
from analysis.correction.programs.target import (
    Flags,
    Form,
    Gathered,
    Left,
    Parsed,
    Reason,
    Target,
    Way,
    blanked,
    numbers_in,
)

DECIMALS = Decimals(place=(3, 3), turn=(4, 4))
"""The job format's own resolution."""
_BLANK = re.compile(r"\"[^\"\n]*\"|(?:^|(?<=\s))'[^\n]*", re.MULTILINE)
_POSITION = re.compile(r"\s*([BE]?C\d{1,6}|B?P\d{1,6})\s*=(.*)")
_MOVE = re.compile(r"\s*(S?MOV[JLCS]|IMOV)\s+(\S+)(.*)")
_STANDS = re.compile(r"\s*(?:NOP|TIMER|DOUT|WAIT|PAUSE|SPEED|AOUT|SET|CLEAR|INC|DEC|ADD|SUB|PULSE|///|$)")


@dataclass
class _State:
    """What holds for the positions that follow."""

    kind: str = "PULSE"
    tool: str = "0"
    user: str = "unset"
    posture: tuple[int, ...] = ()


def parse(texts: tuple[str, ...]) -> Parsed:
    """Return the targets of a job."""
    text = blanked(texts[0], _BLANK)
    gathered, state = Gathered(), _State()
    at, shifted, moving = 0, False, False
    for number, ended in enumerate(text.split("\n"), start=1):
        begin, at, line = at, at + len(ended) + 1, ended.rstrip("\r")
        if line.startswith("//INST"):
            moving = True
        elif not moving:
            _read(line, begin, number, state, gathered)
        elif line.strip().startswith(("SFTON", "SFTOF")):
            shifted = line.strip().startswith("SFTON")
            gathered.stop()
        elif move := _MOVE.match(line):
            _move(move, number, gathered, shifted=shifted)
        elif not _STANDS.match(line):
            gathered.stop()
    return gathered.parsed()


def _read(line: str, begin: int, number: int, state: _State, gathered: Gathered) -> None:
    words = line.split()
    match words:
        case ["///TOOL", tool, *_]:
            state.tool = tool.split(",")[0]
        case ["///USER", user, *_]:
            state.user = user
        case ["///POSTYPE", kind, *_]:
            state.kind = kind.upper()
        case ["///PULSE"]:
            state.kind = "PULSE"
        case ["///RCONF", values, *_]:
            state.posture = tuple(int(value) if value in ("0", "1") else -1 for value in values.split(",")[:6])
    found = _POSITION.fullmatch(line)
    if not found:
        return
    numbers = numbers_in(line, found.start(2), found.end(2)) or ()
    numbers = tuple(type(one)(begin + one.begin, begin + one.end, one.value) for one in numbers)
    pulses = state.kind == "PULSE"
    frame = {"BASE": "base", "ROBOT": "base", "USER": state.user}.get(state.kind, state.kind.lower())
    flags = Flags("yaskawa", state.posture) if len(state.posture) == 6 and not pulses else None
    form: Form = "pulses" if pulses else "roll_pitch_yaw"
    target = Target(found[1], 0, number, form, numbers, state.tool, frame, flags)
    gathered.declare(found[1], target, _reason(found[1], len(numbers)))


def _reason(name: str, count: int) -> Reason | None:
    if name[0] in "BE" or count > 6:
        return "external_axes"
    if name[0] == "P":
        return "not_literal"
    return None if count == 6 else "incomplete"


def _move(move: re.Match[str], number: int, gathered: Gathered, *, shifted: bool) -> None:
    name, rest = move[2], move[3]
    way: Way = "joint" if move[1].endswith("MOVJ") else "line"
    reason: Reason | None = None
    if move[1] == "IMOV":
        reason = "relative"
    elif re.search(r"\b[BE](?:C|P|X)\d+|\+\s*S?MOV", rest):
        reason = "external_axes"
    if reason:
        if gathered.knows(name):
            gathered.change(name)
        gathered.leave(Left(0, number, name[:60], reason))
    elif shifted:
        gathered.offset(name, Left(0, number, name[:60], "offset"))
    else:
        gathered.move(name, way, Left(0, number, name[:60], "not_literal"))
