"""The machine data of a KUKA backup: the foot of the robot in the world, and the lengths of the arm.

Source: $machine.dat of KRC2 and KRC4 backups, whose remarks name each variable ($ROBROOT: the robot in the world,
$LENGTH_A and $LENGTH_B: lengths of the basic axes).
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

import numpy as np

from analysis.apps.makers.backup_arm import other_lengths
from analysis.apps.makers.numbers import frame_of, is_frame
from analysis.apps.makers.points import Place, as_value
from analysis.apps.makers.program_machine import Unknown
from analysis.apps.makers.program_parser import NUMBER
from analysis.apps.makers.target import ProgramTexts
from rigs.schema.robot import Robot

_FOOT = re.compile(r"\$ROBROOT\s*=(?!=)\s*(\{[^{}\n]*\})?", re.IGNORECASE)
_COMPONENT = re.compile(rf"\b([XYZABC])\s+({NUMBER})", re.IGNORECASE)
_LENGTH = re.compile(rf"\$LENGTH_([AB])\s*=\s*({NUMBER})", re.IGNORECASE)
_AXES = {"A": 2, "B": 3}
"""Axis whose length `a` each variable states."""


def foot_of(names: Sequence[str], texts: Sequence[str]) -> Place | None:
    """The foot of the robot in the world, None if no file states it. It is unknown if several files or a program state
    different ones."""
    found: dict[Place, None] = {}
    for file, text in enumerate(texts):
        for stated in _FOOT.finditer(text):
            line = text.count("\n", 0, stated.start()) + 1
            parts = {letter.upper(): float(number) for letter, number in _COMPONENT.findall(stated[1] or "")}
            values = [parts.get(letter, np.nan) for letter in "XYZABC"]
            is_stated = _is_machine(names[file]) and is_frame("yaw_pitch_roll", values)
            unknown = Unknown(file, line, "$ROBROOT, the foot of the robot in the world, is unknown")
            found[as_value(frame_of("yaw_pitch_roll", values)) if is_stated else unknown] = None
    unknown_places = [place for place in found if isinstance(place, Unknown)]
    if len(found) > 1 and not unknown_places:
        return Unknown(0, 0, "these files state several places of the robot in the world ($ROBROOT)")
    return next(iter([*unknown_places, *found]), None)


def other_arm(program: ProgramTexts, robot: Robot) -> str:
    """Explain which lengths of the backup differ from those of a robot; empty if they fit."""
    return next(filter(None, _differences(program, robot)), "")


def _differences(program: ProgramTexts, robot: Robot) -> Iterator[str]:
    for name, text in zip(program.names, program.texts, strict=True):
        if _is_machine(name):
            lengths = {_AXES[letter.upper()]: float(number) for letter, number in _LENGTH.findall(text)}
            yield other_lengths(name, lengths, robot)


def _is_machine(name: str) -> bool:
    return name.upper().rpartition("/")[2] == "$MACHINE.DAT"
