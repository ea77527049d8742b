"""Targets in Acme's programs, from the manual and apart from writer and driver. What is on no list here may change
anything: after it nothing is corrected."""

from __future__ import annotations

import re

from analysis.apps.makers.numbers import Decimals, frame_of
from analysis.apps.makers.points import Points, as_value
from analysis.apps.makers.program_machine import OFF, Blocks, ForgetAll, Move, Program, Ref, Set, Unknown, Value
from analysis.apps.makers.program_reader import ProgramReader, Remark
from analysis.apps.makers.target import Form, Parsed, ProgramTexts, Target, blanked, lines_of, numbers_in, with_newlines

_REMARK = re.compile(r";[^\n]*")
_LINE = re.compile(r"^[ \t]*(?:(?P<word>[A-Z]+) (?P<numbers>[-+\d.,]+))?(?P<rest>[^\n]*)$", re.MULTILINE)
_TARGET = re.compile(r"JOINTS|LINE|TURN|VIA|ARC")
_REST = re.compile(r"( SPEED [\d.]+)?( PATH)?( BLEND)?\s*")
"""What stands behind a target and does not change where it is."""
_NOTHING = re.compile(r"WAIT [\d.]+|OUTPUT \d+ (?:ON|OFF)|PAUSE|")
"""Instructions that change neither the tool nor where the arm stands."""


def parse(texts: ProgramTexts) -> Parsed:
    """Return the targets of a program."""
    text = blanked(with_newlines(texts.texts[0]), _REMARK)
    lines, points, blocks = lines_of(text), Points(1), Blocks()
    for line in _LINE.finditer(text):
        number, word = lines.at(line.end()), line["word"]
        numbers = numbers_in(text, *line.span("numbers")) if word else None
        whole = numbers is not None and len(numbers) == 6 and _REST.fullmatch(line["rest"]) is not None
        if numbers and whole and _TARGET.fullmatch(word):
            form: Form = "joints_deg" if word == "JOINTS" else "roll_pitch_yaw"
            way = "joint" if word == "JOINTS" else "line"
            points.declare(str(number), Target(word, 0, number, form, numbers, frame="base"))
            blocks.add(Move(str(number), way, 0, number, Ref("tool"), needs=("shift",)))
        elif numbers and whole and word == "TOOL":
            blocks.add(Set("tool", as_value(frame_of("roll_pitch_yaw", [part.value for part in numbers]))))
        elif not _NOTHING.fullmatch(line[0].strip()):
            blocks.add(ForgetAll(Unknown(0, number, "it is not known here")))
    return points.parsed(Program({"": blocks.finish_routine()}, _initial))


def _initial(part: str) -> Value:
    return Unknown(0, 0, "nothing sets a tool before") if part == "tool" else OFF


READER = ProgramReader(parse, Decimals(place=(3, 7), turn=(3, 9)), Remark("; "), null_frames=("base",))
