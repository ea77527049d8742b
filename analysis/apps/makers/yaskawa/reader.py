"""Reader of targets in Yaskawa jobs (.JBI): positions in pulses, or in mm and degrees with posture (RCONF).

Source: Yaskawa, DX100 Options, Instructions for data transmission (156191-1CD), chapter 4, and Instructions for INFORM
language (RE-CKI-A457). BASE and ROBOT refer to the robot's base, because poses are corrected only with the base axis
(BC, BP), which carries the arm, at zero. Station axes (EC, EX) matter only if the move is coordinated with them
(SMOVL). Pulses are joint angles and depend on neither.

The controller takes the values of position variables (P) when it loads a job, and all jobs share them. They are
corrected only in a directory with all jobs, in every job that contains their values, if these are equal.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np

from analysis.apps.makers.configuration import agreeing
from analysis.apps.makers.numbers import Decimals
from analysis.apps.makers.program_machine import (
    EXTERNAL,
    OFF,
    ComputedValue,
    Elsewhere,
    End,
    Jump,
    JumpTarget,
    Move,
    Needs,
    Ref,
    Set,
    Statement,
    Unknown,
    Value,
)
from analysis.apps.makers.program_parser import ProgramParser, numbers_in, word_set
from analysis.apps.makers.program_reader import ProgramReader, Remark
from analysis.apps.makers.target import Flags, Form, NamedFrame, Notice, Parsed, ProgramTexts, Target
from analysis.apps.makers.yaskawa.backup import TABLES, frames_in
from analysis.correction.reasons import Reason
from analysis.robot.kinematics.arm import Arm, Array, Mask

_DECIMALS = Decimals(place=(3, 3), turn=(4, 4))
_BLANK = re.compile(r"\"[^\"\n]*\"|(?:^|(?<=\s))'[^\n]*|(?<=\S)[ \t]+//[^\n]*", re.MULTILINE)
_POSITION = re.compile(r"\s*(C|P|BC|BP|EC|EX)(\d{1,6})\s*=(.*)")
_MOVE = re.compile(r"(?P<kind>S?MOV[JLCS]|E?IMOV)\s+(?P<point>\S+)(?P<rest>.*)")
_POINT = re.compile(r"(C|P)(\d{1,6})")
_OF_BASE = re.compile(r"\b(BC|BP)(\d{1,6})\b")
_OF_STATION = re.compile(r"\bE[CX]\d{1,6}\b")
_BASE_PART = f"{EXTERNAL}[BC]"
_CALL = re.compile(r"(?P<word>CALL|PSTART)\b.*?\bJOB\s*:\s*(?P<job>\S+)(?P<rest>.*)")
_FIRST_ROBOT = "RB1"
_BASE_AXIS = re.compile(r"\bB[CPX]\d+")
_GROUP = re.compile(r"^///GROUP1[ \t]+(\w+)", re.MULTILINE)
_NAME = re.compile(r"(?:\b|ARGF)(C|PX?)(\d{1,6})\b")
_ANY_VARIABLE = re.compile(r"(?<![A-Z])PX?\[")
"""Any position variable: its number is in a variable."""
_MODIFIERS = re.compile(
    r"\b(?:VJ|VR|VE|V|PL|ACC|DEC|CR|P|SPD|AVP|ATT)\s*=\s*(?:L?[IDRB])?[\d.]+|\b(?:NWAIT|FPT|CONT)\b|[\s,]"
)
"""Options after a target that change neither position nor posture: speeds, corners, no waiting."""
_UNTIL = re.compile(r"\bUNTIL\b.*")
_TRACKED = re.compile(r"\bCV#|\bSYNC\b")
_FRAME = re.compile(r"(?P<word>MFRAME|SETTOOL|SETUFRAME|SETUF|SETFILE(?=.*\b(?:UF|TL)#))\b(?P<rest>.*)")
_NOTHING = word_set("""
    NOP PAUSE TIMER DOUT DIN AOUT PULSE WAIT SET SETE SETR GETE GETS GETPOS CLEAR INC DEC ADD SUB MUL DIV MOD CNVRT
    MULMAT INVMAT AND OR NOT XOR SIN COS TAN ATAN SQRT SQRTS SPEED MSG PRINT ARCON ARCOF ARCSET ARCCTS ARCCTE WVON WVOF
    AWELD VWELD SVSPOT SVGUNCL GUNCL GUNCHG SVDRESSMV PWAIT CLOSE OPEN DIALOG DIALOGVAL SETUALM RSTUALM
    VAL2STR STR2VAL ASC CHR$ MID$ LEN CAT$ GETREG SETREG BIND REFP HAND HSEN TOOLON TOOLOF PAINTON PAINTOF SPYON SPYOF
    HPVELON HPVELOF GETFILE SETFILE DOUTWAIT CLRSTP LATCH ADVINIT ADVSTOP DELAY SWAIT CWAIT TSYNC MSHIFT
    """)
"""Instructions that change neither tool, frame and shift nor the position of the arm."""
_SWITCHES = {
    "SFTON": ("shift", "on"), "SFTOF": ("shift", OFF), "CVON": ("tracking", "on"), "CVOF": ("tracking", OFF),
    "SYSTART": ("tracking", "on"), "SYEND": ("tracking", OFF), "COMARCON": ("tracking", "on"),
    "COMARCOF": ("tracking", OFF), "MTOFON": ("shift", "on"), "MTOFOF": ("shift", OFF),
}  # fmt: skip

_FLOW = {
    **dict.fromkeys(("IFTHEN", "IFTHENEXP", "IF"), "if"), **dict.fromkeys(("ELSEIF", "ELSEIFEXP", "CASE"), "case"),
    "SWITCH": "switch", "ELSE": "else", "DEFAULT": "else", "BREAK": "break", "CONTINUE": "continue",
    **dict.fromkeys(("WHILE", "WHILEEXP", "FOR"), "while"),
    **dict.fromkeys(("ENDIF", "ENDSWITCH", "ENDWHILE", "NEXT", "ENDFOR"), "end"),
}  # fmt: skip


_SHARED = "position variables (P) are shared by all jobs of the controller: the directory has to contain all of them"


@dataclass
class _State:
    """Settings for the positions that follow."""

    kind: str = "PULSE"
    tool: str = "0"
    user: str = "unset"
    rconf: tuple[int, ...] = ()


class _InformReader(ProgramParser):
    def __init__(self, program: ProgramTexts) -> None:
        super().__init__(program, _BLANK)
        self.stated = frames_in(program.tables)
        """Tools and user frames of a backup."""
        self.is_complete = program.is_directory
        """True if the user gave the directory of all jobs, and not a single job."""
        self.variables: dict[int, list[str]] = {}
        """Keys of the points of a position variable: one for each job with its values."""
        self.base_at: dict[str, str] = {}
        """Position of the base axis, off at zero, by the key of its BC."""
        self.job = ""
        """Key of the current job, by file and line."""
        self.is_foreign = False
        self.frame: str | None = None
        for file, text in enumerate(self.texts):
            lines = text.split("\n")
            jobs = {str(number): line[6:].strip() for number, line in enumerate(lines) if line.startswith("//NAME")}
            for number, name in (jobs or {"": self.names[file].rpartition(".")[0]}).items():
                self.defined.setdefault(name.upper(), []).append(f"{file}:{number}")
            self.points.axes |= {"BC"} if _BASE_AXIS.search(text) else set()
        groups = [group for text in self.texts[: self.own] for group in _GROUP.findall(text)]
        self.group = _FIRST_ROBOT if _FIRST_ROBOT in groups else next(iter(groups), "")
        """The robot whose jobs are corrected."""
        if self.group not in ("", _FIRST_ROBOT):
            fact = f"the jobs move {self.group}, not the first robot of the controller: is the rig file that robot's?"
            self.points.notices.append(Notice(0, 1, fact))

    def named(self, name: str) -> list[str]:
        jobs = super().named(name)
        same = [job for job in jobs if job.startswith(f"{self.file}:")]
        own = [job for job in jobs if int(job.partition(":")[0]) < self.own]
        return next((found for found in (same, own) if len(found) == 1), jobs)

    def keys(self, kind: str, number: str) -> list[str]:
        """Keys of a position, which belongs to a job, or of a variable, which all jobs share."""
        return self.variables.get(int(number), []) if kind == "P" else [f"{self.job}/{kind}{int(number)}"]

    def declare(self, file: int) -> None:
        """Read the positions of the jobs in a file."""
        self.job, state, is_moving = f"{file}:", _State(), False
        for number, line in enumerate(self.lines(file)):
            if line.startswith(("/JOB", "//NAME")):
                self.job = f"{file}:{number}" if line.startswith("//NAME") else self.job
                state, is_moving = _State(), False
            elif line.startswith("//INST"):
                is_moving = True
            elif not is_moving:
                self._position(line, state)

    def read(self, file: int) -> None:
        """Read the instructions of the jobs in a file."""
        self.job = f"{file}:"
        self.begin_routine(self.job)
        is_moving = has_moves = False
        for number, line in enumerate(self.lines(file)):
            if line.startswith(("/JOB", "//NAME")):
                if line.startswith("//NAME"):
                    self.routine = self.routine if has_moves else None  # Only a job with instructions is a routine.
                    self.job = f"{file}:{number}"
                    self.begin_routine(self.job)
                    has_moves = False
                is_moving, self.frame, self.is_foreign = False, None, False
            elif line.startswith("//INST"):
                is_moving = has_moves = True
            elif is_moving:
                self._instruction(line.strip())
        self.end_routine()

    def _position(self, line: str, state: _State) -> None:
        match line.split():
            case ["///TOOL", tool, *_]:
                state.tool = tool.split(",")[0]
            case ["///USER", user, *_]:
                state.user = user
            case ["///POSTYPE", kind, *_]:
                state.kind = kind.upper()
            case ["///PULSE"]:
                state.kind = "PULSE"
            case ["///RCONF", values, *_]:
                state.rconf = tuple(int(value) if value in ("0", "1") else -1 for value in values.split(",")[:6])
        position = _POSITION.fullmatch(line)
        if not position or position[1] in ("BP", "EC", "EX"):
            return
        key = f"{self.job}/{position[1]}{int(position[2])}"
        numbers = numbers_in(line, *position.span(3), self.at) or ()
        if position[1] == "BC":
            self.base_at[key] = "moved" if any(number.value for number in numbers) or not numbers else OFF
        elif self.is_own:
            pulses, frame = state.kind == "PULSE", _frame(state.kind, state.user)
            flags = Flags(state.rconf, _agreeing) if len(state.rconf) == 6 and not pulses else None
            form: Form = "pulses" if pulses else "roll_pitch_yaw"
            name = f"{position[1]}{position[2]}"
            reason: Reason | None = "external_axes" if len(numbers) > 6 else None if len(numbers) == 6 else "incomplete"
            if position[1] == "P" and not self.is_complete:
                reason = reason or "shared_variable"
            target = Target(name, self.file, self.line(), form, numbers, state.tool, frame, flags)
            self.points.declare(key, target, reason)
            if position[1] == "P":
                self._share(int(position[2]), key)

    def _share(self, number: int, key: str) -> None:
        """Add the values of a variable. Different ones are uncertain: the job loaded last determines the variable."""
        keys, declared = self.variables.setdefault(number, []), self.points.declared
        if key in keys:
            return
        keys.append(key)
        if _meaning(declared[keys[0]].target) != _meaning(declared[key].target):
            self.change(keys[0])
        if declared[keys[0]].changed:
            place = declared[keys[0]].target
            for other in keys[1:]:
                self.points.change(other, place.file, place.line)
        if not self.points.notices or self.points.notices[-1].text != _SHARED:
            self.points.notices += [Notice(self.file, self.line(), _SHARED)] * self.is_complete

    def _instruction(self, text: str) -> None:
        if text.startswith("///") or not text:
            self._heading(text)
            return
        if move := _MOVE.match(text):
            self._move(move)
            return
        self._mentioned(text)
        label = text.split(maxsplit=1)[0]
        word = label.upper()
        is_conditional = re.search(r"\bIF\b", text[len(word) :]) is not None
        add = self.blocks.add_conditional if is_conditional else self.blocks.add
        if text.startswith("*"):
            self.add(JumpTarget(label))
        elif word == "JUMP":
            self._jump(text, falls=is_conditional)
        elif call := _CALL.match(text):
            self._call(call)
        elif word in ("RET", "END", "ABORT"):
            add(End(halts=word == "ABORT"))
        elif frame := _FRAME.match(text):
            self._set_frame(frame["word"], frame["rest"])
        elif word in _SWITCHES:
            self.set(*_SWITCHES[word])
        elif word in _FLOW:
            self.blocks.keyword(_FLOW[word])
            if word == "SWITCH" and re.search(r"\bCASE\b", text, re.IGNORECASE):  # The first CASE, on the same line
                self.blocks.keyword("case")
        elif word not in _NOTHING | self.neutral:
            self.not_known(text)

    def _set_frame(self, word: str, rest: str) -> None:
        number = re.search(r"\b(?:UF|TL)#\((\d+)\)", rest)
        family = "TOOL" if word == "SETTOOL" or "TL#" in rest else "USER"
        why = self.why(f"{word} sets it")
        if number:
            self.set(f"{family}[{int(number[1])}]", why)
        else:
            self.forget(family, why)

    def _mentioned(self, text: str) -> None:
        keys = [key for mention in _NAME.finditer(text) for key in self.keys(mention[1][0], mention[2])]
        if _ANY_VARIABLE.search(text):
            keys += [key for of_variable in self.variables.values() for key in of_variable]
        for key in keys:
            self.change(key)

    def _heading(self, text: str) -> None:
        """Parse the frame of a relative job, or the robot that the job moves."""
        if text.startswith("////FRAME"):
            kind, user = (*text.upper().split()[1:3], "", "")[:2]
            self.frame = _frame(kind, user)
        if group := _GROUP.match(text):
            self.is_foreign = self.group not in ("", group[1])

    def _jump(self, text: str, *, falls: bool) -> None:
        if label := re.search(r"\*\S+", text):
            self.add(Jump((label[0],), falls=falls))
        elif job := re.search(r"\bJOB\s*:\s*(\S+)", text):  # A jump to a job does not return.
            self.blocks.add_conditional(self.call_of(job[1]), End())
            if not falls:
                self.add(End())
        else:
            self.not_known(text)

    def _call(self, call: re.Match[str]) -> None:
        if call["word"] == "PSTART":
            self.runs_beside(call["job"])
            return
        statements: list[Statement] = [self.call_of(call["job"])]
        if re.search(r"\bUF#", call["rest"]):  # A relative job, in the user frame of the call
            elsewhere = self.why(f"{call['job']} is called in a different user frame")
            statements = [Set("relative", elsewhere), *statements, Set("relative", OFF)]
        (self.blocks.add_conditional if re.search(r"\bIF\b", call["rest"]) else self.blocks.add)(*statements)

    def _move(self, move: re.Match[str]) -> None:
        options, _, other_group = move["rest"].partition("+")
        name = move["point"]
        if _OF_STATION.fullmatch(name):
            return
        base = _OF_BASE.search(options)
        if base or _OF_BASE.fullmatch(name):
            at = self.base_at.get(f"{self.job}/{base[1]}{int(base[2])}") if base else None
            self.set(_BASE_PART, self.why("a variable states the base axis") if at is None else at)
        options = _OF_BASE.sub("", _OF_STATION.sub("", options))
        point = _POINT.fullmatch(name)
        keys = [key for key in (self.keys(point[1], point[2]) if point else ()) if key in self.points.declared]
        is_relative = move["kind"].endswith("IMOV")
        reason: Reason | None = "relative" if is_relative else "other_robot" if self.is_foreign else None
        if reason or not keys:
            if reason != "other_robot":
                self._mentioned(name)
            self.leave(reason or "not_literal", name, relative=is_relative)
            return
        for key in keys:
            self._move_to(key, move["kind"], options, other_group)
        if _UNTIL.search(options):
            self.add(Elsewhere())

    def _move_to(self, key: str, kind: str, options: str, other_group: str) -> None:
        unknown = _MODIFIERS.sub("", _UNTIL.sub("", re.sub(r"\bCV#\([^)]*\)|\bSYNC\b", "", options))).strip()
        target = self.points.declared[key].target
        tool = Ref(f"TOOL[{int(str(target.tool))}]") if str(target.tool).isdigit() else str(target.tool)
        user = str(target.frame)
        frame: Value | ComputedValue = self.why("the job and the positions use different frames")
        if target.joints:
            frame = user
        elif self.frame in (None, user):
            parts = (f"USER[{int(user)}]",) if user.isdigit() else ()
            frame = ComputedValue(("relative", *parts), partial(_unless_relative, user))
        needs: Needs = (
            ("displaced", Ref("shift")),
            ("tracked", "on" if _TRACKED.search(options) else Ref("tracking")),
            ("coordinated", "on" if kind.startswith("S") or "SMOV" in other_group else OFF),
            ("not_understood", self.why(f"{unknown} is unknown here") if unknown else OFF),
        )
        way = "joint" if kind.endswith("MOVJ") else "line"
        self.add(Move(key, way, self.file, self.line(), tool, frame, needs))

    def initial(self, variable: str) -> Value:
        family, _, number = variable.partition("[")
        if variable in self.stated:
            return self.stated[variable]
        return number.rstrip("]") if family in ("USER", "TOOL") else OFF


def parse(program: ProgramTexts) -> Parsed:
    reader = _InformReader(program)
    for step in (reader.declare, reader.read):
        for file in range(len(program.texts)):
            step(file)
    for variable, value in reader.stated.items():
        family, _, number = variable.rstrip("]").partition("[")
        if isinstance(value, tuple):
            kind: Literal["tool", "frame"] = "tool" if family == "TOOL" else "frame"
            reader.points.sets.append(NamedFrame(number, kind, 0, 1, value))
    if program.tables:
        files = " and ".join(name for name, _ in program.tables)
        reader.points.notices.append(Notice(0, 1, f"tools and user frames are those of {files} beside it"))
    return reader.points.parsed(reader.program(kept=("USER[", "TOOL["), cycles=True))


def _frame(kind: str, user: str) -> str:
    return {"BASE": "base", "ROBOT": "base", "USER": user}.get(kind, kind.lower())


def _agreeing(arm: Arm, q: Array, values: tuple[int, ...], slack_rad: float) -> Mask:
    """Check RCONF: no flip, not up, not front, and whether R, T and S are beyond half a turn."""
    sides, numbers = tuple(1 - value for value in values[:3]), dict(zip((3, 5, 0), values[3:], strict=True))
    return agreeing(arm, q, sides, numbers, lambda angle: int(not -np.pi < angle <= np.pi), slack_rad)


def _unless_relative(name: str, values: tuple[Value, ...]) -> Value:
    """Frame of a position, by value or name; unknown if the job runs in the frame of its call."""
    relative, *frame = values
    return relative if isinstance(relative, Unknown) else frame[0] if frame else name


def _meaning(target: Target) -> tuple[object, ...]:
    """What equal values of a variable have in common."""
    flags = target.flags.values if target.flags else ()
    return target.form, tuple(number.value for number in target.numbers), target.tool, target.frame, flags


READER = ProgramReader(
    parse,
    _DECIMALS,
    Remark("'", width=32, before={".jbi": re.compile(rb"^[ \t]*END\b", re.MULTILINE)}),
    null_frames=("base",),
    beside=(".jbi",),
    tables=TABLES,
    is_together=True,
    empty="/JOB\n//NAME {0}\n//POS\n//INST\nNOP\nEND\n",
)
"""Comments have at most 32 characters (RE-CKI-A457)."""
