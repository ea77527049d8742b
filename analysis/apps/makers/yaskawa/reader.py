"""Reader of targets in Yaskawa jobs (.JBI): positions in pulses, or in mm and degrees with posture (RCONF).

Source: Yaskawa, DX100 Options, Instructions for data transmission (156191-1CD), chapter 4, and Instructions for INFORM
language (RE-CKI-A457). BASE and ROBOT refer to the robot's base, because poses are corrected only with the base axis
at zero. USER n is a frame stated by the user. IMOV is relative. Between SFTON and SFTOF every position is shifted,
including those in called jobs. A file can contain several jobs.

Station axes (EC, EX) move the workpiece: they do not matter unless the move is coordinated with them (SMOVL). A base
axis (BC, BP) carries the arm. Pulses are joint angles and do not depend on either. A job contains the values of the
position variables (P) that it uses, which the controller takes when it loads the job. All jobs share them, so a
variable that another job contains, too, is not corrected.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from analysis.apps.makers.numbers import Decimals
from analysis.apps.makers.points import Points
from analysis.apps.makers.program_machine import (
    EXTERNAL,
    OFF,
    Blocks,
    Call,
    ComputedValue,
    Elsewhere,
    End,
    ForgetAll,
    ForgetFamily,
    Jump,
    JumpTarget,
    Move,
    Program,
    Ref,
    Set,
    Statement,
    Unknown,
    Value,
)
from analysis.apps.makers.program_reader import ProgramReader, Remark
from analysis.apps.makers.programs.posture import agreeing
from analysis.apps.makers.target import (
    Flags,
    Form,
    Notice,
    Parsed,
    ProgramTexts,
    Target,
    UncorrectedTarget,
    blanked,
    numbers_in,
    with_newlines,
    words,
)
from analysis.correction.reasons import Reason
from analysis.robot.kinematics.arm import Arm, Array, Mask

_DECIMALS = Decimals(place=(3, 3), turn=(4, 4))
"""The resolution of the job format."""
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
"""A position or a variable of a base axis."""
_GROUP = re.compile(r"^///GROUP1[ \t]+(\w+)", re.MULTILINE)
_NAME = re.compile(r"(?:\b|ARGF)(C|PX?)(\d{1,6})\b")
_ANY_VARIABLE = re.compile(r"(?<![A-Z])PX?\[")
"""A position variable whose number is in a variable: it can be any."""
_MODIFIERS = re.compile(
    r"\b(?:VJ|VR|VE|V|PL|ACC|DEC|CR|P|SPD|AVP|ATT)\s*=\s*(?:L?[IDRB])?[\d.]+|\b(?:NWAIT|FPT|CONT)\b|[\s,]"
)
"""Options after a target without influence on the position or posture: speeds, corners, no waiting."""
_UNTIL = re.compile(r"\bUNTIL\b.*")
_TRACKED = re.compile(r"\bCV#|\bSYNC\b")
_FRAME = re.compile(r"(?P<word>MFRAME|SETTOOL|SETUFRAME|SETUF|SETFILE(?=.*\b(?:UF|TL)#))\b(?P<rest>.*)")
_NOTHING = words("""
    NOP PAUSE TIMER DOUT DIN AOUT PULSE WAIT SET SETE SETR GETE GETS GETPOS CLEAR INC DEC ADD SUB MUL DIV MOD CNVRT
    MULMAT INVMAT AND OR NOT XOR SIN COS TAN ATAN SQRT SQRTS SPEED MSG PRINT ARCON ARCOF ARCSET ARCCTS ARCCTE WVON WVOF
    AWELD VWELD SVSPOT SVGUNCL GUNCL GUNCHG SVDRESSMV PWAIT CLOSE OPEN DIALOG DIALOGVAL SETUALM RSTUALM
    VAL2STR STR2VAL ASC CHR$ MID$ LEN CAT$ GETREG SETREG BIND REFP HAND HSEN TOOLON TOOLOF PAINTON PAINTOF SPYON SPYOF
    HPVELON HPVELOF GETFILE SETFILE DOUTWAIT CLRSTP LATCH ADVINIT ADVSTOP DELAY SWAIT CWAIT TSYNC MSHIFT
    """)
"""Instructions that do not change tool, frame, shift or arm position: variables, signals, waiting, messages,
welding.
"""
_SWITCHES = {
    "SFTON": ("shift", "on"), "SFTOF": ("shift", OFF), "CVON": ("tracking", "on"), "CVOF": ("tracking", OFF),
    "SYSTART": ("tracking", "on"), "SYEND": ("tracking", OFF), "COMARCON": ("tracking", "on"),
    "COMARCOF": ("tracking", OFF), "MTOFON": ("shift", "on"), "MTOFOF": ("shift", OFF),
}  # fmt: skip

_FLOW: dict[str, tuple[Callable[[Blocks], None], ...]] = {
    **dict.fromkeys(("IFTHEN", "IFTHENEXP", "IF"), (Blocks.branch,)),
    "SWITCH": (Blocks.cases,),
    **dict.fromkeys(("ELSEIF", "ELSEIFEXP", "CASE"), (Blocks.other, Blocks.guard)),
    **dict.fromkeys(("ELSE", "DEFAULT"), (Blocks.other,)),
    **dict.fromkeys(("WHILE", "WHILEEXP", "FOR"), (Blocks.loop, Blocks.may_leave)),
    **dict.fromkeys(("ENDIF", "ENDSWITCH", "ENDWHILE", "NEXT", "ENDFOR"), (Blocks.close,)),
    "BREAK": (Blocks.leave,),
    "CONTINUE": (Blocks.again,),
}
"""Actions of the keywords of a block."""


@dataclass
class _State:
    """Settings for the positions that follow."""

    kind: str = "PULSE"
    tool: str = "0"
    user: str = "unset"
    posture: tuple[int, ...] = ()


@dataclass
class _YaskawaReader:
    points: Points
    jobs: dict[str, list[str]] = field(default_factory=dict)
    base_at: dict[str, str] = field(default_factory=dict)
    """Position of the base axis, off at zero, by the key of its BC."""
    routines: dict[str, tuple[Statement, ...]] = field(default_factory=dict)
    beside: list[Call] = field(default_factory=list)
    file: int = 0
    line: int = 0
    job: str = ""
    group: str = ""
    """The robot whose jobs are corrected: the robot of the first job."""
    foreign: bool = False
    """True while the current job moves another robot."""
    frame: str | None = None
    """The frame of a relative job."""
    blocks: Blocks = field(default_factory=Blocks)
    neutral: frozenset[str] = frozenset()
    """Macro instructions that change nothing, as stated by the user, in upper case."""

    def why(self, fact: str) -> Unknown:
        return Unknown(self.file, self.line, " ".join(fact.split())[:80])

    def leave(self, name: str, reason: Reason) -> None:
        if self.file == 0:
            self.points.leave(UncorrectedTarget(0, self.line, name[:60], reason))
        self.blocks.add(Elsewhere(self.why(name) if self.file and reason == "relative" else None))

    def key(self, kind: str, number: str) -> str:
        """Return the key of a position, which belongs to a job, or of a variable, which all jobs share."""
        return f"{'' if kind == 'P' else self.job}/{kind}{int(number)}"

    def call_of(self, name: str) -> Statement:
        """Return the call of a job, or `ForgetAll` if the name is not unique or not known."""
        jobs = self.jobs.get(name.upper(), [])
        jobs_of_program = [job for job in jobs if job.startswith("0:")]
        callees = jobs_of_program if len(jobs_of_program) == 1 else jobs
        why = self.why(f"{name} is called" if len(callees) == 1 else f"{name} is unknown here")
        return Call(callees[0], why) if len(callees) == 1 else ForgetAll(why)


def parse(texts: ProgramTexts) -> Parsed:
    """Parse the targets of the jobs in a file."""
    reader = _YaskawaReader(Points(1), neutral=frozenset(name.upper() for name in texts.neutral))
    blank = [blanked(with_newlines(text), _BLANK).split("\n") for text in texts.texts]
    for file, lines in enumerate(blank):
        stem = texts.names[file].rpartition(".")[0].upper()
        for number, line in enumerate(lines):
            if line.startswith("//NAME"):
                name = line[6:].strip().upper()
                reader.jobs.setdefault(name, []).append(f"{file}:{number}")
        if not any(line.startswith("//NAME") for line in lines):
            reader.jobs.setdefault(stem, []).append(f"{file}:")
        reader.points.axes |= {"BC" for line in lines if _BASE_AXIS.search(line)}
    if groups := _GROUP.findall("\n".join(blank[0])):
        reader.group = groups[0]
        if reader.group != _FIRST_ROBOT:
            fact = f"the jobs move {reader.group}, not the first robot of the controller: is the rig file that robot's?"
            reader.points.notices.append(Notice(0, 1, fact))
    for file, lines in enumerate(blank):
        _read_file(reader, file, lines)

    def initial(part: str) -> Value:
        family, _, number = part.partition("[")
        return number.rstrip("]") if family in ("USER", "TOOL") else OFF

    return reader.points.parsed(
        Program(reader.routines, initial, tuple(reader.beside), kept=("USER[", "TOOL["), cycles=True)
    )


def _read_file(reader: _YaskawaReader, file: int, lines: list[str]) -> None:
    """Parse the jobs of a file, each with positions and instructions."""
    reader.file, reader.job, reader.blocks = file, f"{file}:", Blocks()
    state, at, moving = _State(), 0, False
    for number, line in enumerate(lines):
        begin, at, reader.line = at, at + len(line) + 1, number + 1
        if line.startswith(("/JOB", "//NAME")):
            if moving:
                reader.routines[reader.job] = reader.blocks.finish_routine()
            state, moving, reader.frame, reader.foreign = _State(), False, None, False
            if line.startswith("//NAME"):
                reader.job, reader.blocks = f"{file}:{number}", Blocks()
        elif line.startswith("//INST"):
            moving = True
        elif not moving:
            _position(reader, line, begin, state)
        else:
            _instruction(reader, line.strip())
    reader.routines[reader.job] = reader.blocks.finish_routine()


def _position(reader: _YaskawaReader, line: str, begin: int, state: _State) -> None:
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
    position = _POSITION.fullmatch(line)
    if not position or position[1] in ("BP", "EC", "EX"):
        return
    name, key = f"{position[1]}{position[2]}", reader.key(position[1], position[2])
    numbers = numbers_in(line, position.start(3), position.end(3)) or ()
    numbers = tuple(type(number)(begin + number.begin, begin + number.end, number.value) for number in numbers)
    if position[1] == "BC":
        reader.base_at[key] = "moved" if any(number.value for number in numbers) or not numbers else OFF
        return
    pulses = state.kind == "PULSE"
    frame = _frame(state.kind, state.user)
    flags = Flags(state.posture, _agreeing) if len(state.posture) == 6 and not pulses else None
    form: Form = "pulses" if pulses else "roll_pitch_yaw"
    target = Target(name, 0, reader.line, form, numbers, state.tool, frame, flags)
    if reader.file == 0:
        reason: Reason | None = "external_axes" if len(numbers) > 6 else None if len(numbers) == 6 else "incomplete"
        reader.points.declare(key, target, reason)
    elif position[1] == "P" and reader.points.knows(key):  # The job loaded last determines the variable.
        reader.points.change(key, reader.file, reader.line)


def _frame(kind: str, user: str) -> str:
    """Return the name of the frame of positions, or of a relative job."""
    return {"BASE": "base", "ROBOT": "base", "USER": user}.get(kind, kind.lower())


def _agreeing(arm: Arm, q: Array, values: tuple[int, ...], slack_rad: float) -> Mask:
    """Return a mask (n,) of the solutions q (n, 6) rad that agree with the first six values of RCONF.

    These are: no flip, not up, not front, in the sense of `rig program`, and whether R, T and S are beyond half a turn.
    """
    sides, numbers = tuple(1 - value for value in values[:3]), dict(zip((3, 5, 0), values[3:], strict=True))
    return agreeing(arm, q, sides, numbers, lambda angle: int(not -np.pi < angle <= np.pi), slack_rad)


def _instruction(reader: _YaskawaReader, text: str) -> None:
    """Parse an instruction of a job."""
    blocks = reader.blocks
    if text.startswith("///") or not text:
        _heading(reader, text)
        return
    if move := _MOVE.match(text):
        _move(reader, move)
        return
    _mentioned(reader, text)
    word = text.split(maxsplit=1)[0].upper()
    conditional = re.search(r"\bIF\b", text[len(word) :]) is not None
    if text.startswith("*"):
        blocks.add(JumpTarget(text.split(maxsplit=1)[0]))
    elif word == "JUMP":
        _jump(reader, text, falls=conditional)
    elif call := _CALL.match(text):
        _call(reader, call)
    elif word in ("RET", "END", "ABORT"):
        (blocks.add_conditional if conditional else blocks.add)(End(halts=word == "ABORT"))
    elif frame := _FRAME.match(text):
        number = re.search(r"\b(?:UF|TL)#\((\d+)\)", frame["rest"])
        family = "TOOL" if frame["word"] == "SETTOOL" or "TL#" in frame["rest"] else "USER"
        why = reader.why(f"{frame['word']} sets it")
        blocks.add(Set(f"{family}[{int(number[1])}]", why) if number else ForgetFamily(family, why))
    elif word in _SWITCHES:
        blocks.add(Set(*_SWITCHES[word]))
    elif not _flow(blocks, word, text) and word not in _NOTHING | reader.neutral:
        blocks.add(ForgetAll(reader.why(f"{text} is unknown here")))


def _mentioned(reader: _YaskawaReader, text: str) -> None:
    """Mark the positions that an instruction does not use as a target. A number in a variable can be any variable."""
    keys = [reader.key(mention[1][0], mention[2]) for mention in _NAME.finditer(text)]
    if _ANY_VARIABLE.search(text):
        keys += filter(re.compile("/P").match, reader.points.keys())
    for key in keys:
        if reader.points.knows(key):
            reader.points.change(key, reader.file, reader.line)


def _heading(reader: _YaskawaReader, text: str) -> None:
    """Parse the frame of a relative job, or the robot that the job moves."""
    if text.startswith("////FRAME"):
        kind, user = (*text.upper().split()[1:3], "", "")[:2]
        reader.frame = _frame(kind, user)
    if group := _GROUP.match(text):
        reader.foreign = reader.group not in ("", group[1])


def _flow(blocks: Blocks, word: str, text: str) -> bool:
    """Parse a keyword of a block; False for any other word."""
    for take in _FLOW.get(word, ()):
        take(blocks)
    if word == "SWITCH" and re.search(r"\bCASE\b", text, re.IGNORECASE):  # The first CASE can be on the same line.
        blocks.other()
        blocks.guard()
    return word in _FLOW


def _jump(reader: _YaskawaReader, text: str, *, falls: bool) -> None:
    label = re.search(r"\*\S+", text)
    job = re.search(r"\bJOB\s*:\s*(\S+)", text)
    if label:
        reader.blocks.add(Jump((label[0],), falls=falls))
    elif job:  # A jump to a job does not return.
        reader.blocks.add_conditional(reader.call_of(job[1]), End())
        if not falls:
            reader.blocks.add(End())
    else:
        reader.blocks.add(ForgetAll(reader.why(f"{text} is unknown here")))


def _call(reader: _YaskawaReader, call: re.Match[str]) -> None:
    statement = reader.call_of(call["job"])
    if call["word"] == "PSTART":
        name = statement.name if isinstance(statement, Call) else f"{call['job']} "
        reader.beside.append(Call(name, reader.why(f"{call['job']} may run at any moment")))
        return
    statements = [statement]
    if re.search(r"\bUF#", call["rest"]):  # A relative job, in the user frame of the call
        elsewhere = reader.why(f"{call['job']} is called in a different user frame")
        statements = [Set("relative", elsewhere), statement, Set("relative", OFF)]
    (reader.blocks.add_conditional if re.search(r"\bIF\b", call["rest"]) else reader.blocks.add)(*statements)


def _unless_relative(name: str, values: tuple[Value, ...]) -> Value:
    """Return the frame of a position: a known value or else the name; unknown if the job runs in the frame of its
    call."""
    relative, *frame = values
    return relative if isinstance(relative, Unknown) else frame[0] if frame else name


def _move(reader: _YaskawaReader, move: re.Match[str]) -> None:
    options, _, other_group = move["rest"].partition("+")
    name, blocks = move["point"], reader.blocks
    coordinated = move["kind"].startswith("S") or "SMOV" in other_group
    if _OF_STATION.fullmatch(name):
        return
    base = _OF_BASE.search(options)
    if base or _OF_BASE.fullmatch(name):
        at = reader.base_at.get(reader.key(base[1], base[2])) if base else None
        blocks.add(Set(_BASE_PART, reader.why("a variable states the base axis") if at is None else at))
    options = _OF_BASE.sub("", _OF_STATION.sub("", options))
    point = _POINT.fullmatch(name)
    key = reader.key(point[1], point[2]) if point else ""
    reason: Reason | None = None
    if move["kind"].endswith("IMOV"):
        reason = "relative"
    elif reader.foreign:
        reason = "other_robot"
    if reason or not reader.points.knows(key) or (reader.file and point and point[1] == "C"):
        if reason != "other_robot":
            _mentioned(reader, name)
        reader.leave(name, reason or "not_literal")
        return
    stops = _UNTIL.search(options)
    tracked = _TRACKED.search(options)
    unknown = _MODIFIERS.sub("", _UNTIL.sub("", re.sub(r"\bCV#\([^)]*\)|\bSYNC\b", "", options))).strip()
    blocks.add(Set("tracking here", "on" if tracked else Ref("tracking")))
    blocks.add(Set("coordinated here", "on" if coordinated else OFF))
    blocks.add(Set("option here", reader.why(f"{unknown} is unknown here") if unknown else OFF))
    target = reader.points.target(key)
    tool = Ref(f"TOOL[{int(str(target.tool))}]") if str(target.tool).isdigit() else str(target.tool)
    user = str(target.frame)
    frame: Value | ComputedValue = reader.why("the job and the positions use different frames")
    if target.joints:
        frame = user
    elif reader.frame in (None, user):
        parts = (f"USER[{int(user)}]",) if user.isdigit() else ()
        frame = ComputedValue(("relative", *parts), partial(_unless_relative, user))
    needs = ("shift", "tracking here", "coordinated here", "option here")
    way = "joint" if move["kind"].endswith("MOVJ") else "line"
    blocks.add(Move(key, way, reader.file, reader.line, tool, frame, needs))
    if stops:
        blocks.add(Elsewhere())


READER = ProgramReader(
    parse,
    _DECIMALS,
    Remark("'", width=32, before={".jbi": re.compile(rb"^[ \t]*END\b", re.MULTILINE)}),
    null_frames=("base",),
    beside=(".jbi",),
    empty="/JOB\n//NAME {0}\n//POS\n//INST\nNOP\nEND\n",
)
"""Reader of Yaskawa jobs. Comments have at most 32 characters (RE-CKI-A457); longer remarks take several lines."""
