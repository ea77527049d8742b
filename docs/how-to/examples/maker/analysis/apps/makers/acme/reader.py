"""Targets in Acme's programs, from the manual and apart from writer and driver. What is on no list here may change
anything: after it nothing is corrected."""

from __future__ import annotations

import re

from analysis.apps.makers.numbers import Decimals, frame_of
from analysis.apps.makers.points import as_value
from analysis.apps.makers.program_machine import OFF, Move, Ref, Unknown, Value
from analysis.apps.makers.program_parser import ProgramParser, numbers_in
from analysis.apps.makers.program_reader import ProgramReader, Remark
from analysis.apps.makers.target import Form, Parsed, ProgramTexts, Target

_REMARK = re.compile(r";[^\n]*")
_LINE = re.compile(r"[ \t]*(?:(?P<word>[A-Z]+) (?P<numbers>[-+\d.,]+))?(?P<rest>[^\n]*)")
_TARGET = re.compile(r"JOINTS|LINE|TURN|VIA|ARC")
_REST = re.compile(r"( SPEED [\d.]+)?( PATH)?( BLEND)?\s*")
"""What stands behind a target and does not change where it is."""
_NOTHING = re.compile(r"WAIT [\d.]+|OUTPUT \d+ (?:ON|OFF)|PAUSE|")
"""Instructions that change neither the tool nor where the arm stands."""


class _Reader(ProgramParser):
    def statement(self, text: str) -> None:
        """Parse a line."""
        line = _LINE.fullmatch(text)
        numbers = numbers_in(text, *line.span("numbers"), self.at) if line and line["word"] else None
        if line and numbers and len(numbers) == 6 and _REST.fullmatch(line["rest"]):
            word, number = line["word"], self.line()
            if _TARGET.fullmatch(word):
                form: Form = "joints_deg" if word == "JOINTS" else "roll_pitch_yaw"
                way = "joint" if word == "JOINTS" else "line"
                self.points.declare(str(number), Target(word, 0, number, form, numbers, frame="base"))
                self.add(Move(str(number), way, 0, number, Ref("tool"), needs=(("displaced", Ref("shift")),)))
                return
            if word == "TOOL":
                self.set("tool", as_value(frame_of("roll_pitch_yaw", [part.value for part in numbers])))
                return
        if not _NOTHING.fullmatch(text.strip()):
            self.not_known(text)

    def initial(self, part: str) -> Value:
        return Unknown(0, 0, "nothing sets a tool before") if part == "tool" else OFF


def parse(texts: ProgramTexts) -> Parsed:
    """Return the targets of a program."""
    reader = _Reader(texts, _REMARK)
    reader.begin_routine("")
    for line in reader.lines(0):
        reader.statement(line)
    reader.end_routine()
    return reader.points.parsed(reader.program())


READER = ProgramReader(parse, Decimals(place=(3, 7), turn=(3, 9)), Remark("; "), null_frames=("base",))
