"""Reader of targets in listings of FANUC's teach pendant language (.LS): P[n] with joints, or a pose with CONFIG.

Source: FANUC, R-30iB Operator's Manual (Basic Operation) B-83284EN, chapter 4, and public backups in .LS. A position
contains the user frame UF and the tool frame UT. UF 0 is the world, assumed to be the robot's base as in the arms of
the library, and UT 0 is the flange. INC makes a move relative. Offset and Tool_Offset add a register stored in the
controller. A listing is a single program. Other listings in the directory are read if the program calls them.

The arm is motion group 1. The controller computes its angles from the numbers of this group and its extended axes
alone, so other groups (guns, positioners) do not matter unless a move is coordinated with them (COORD).
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from analysis.apps.makers.external_axes import is_moved
from analysis.apps.makers.fanuc.instructions import INSIDE, OPTIONS, change_by
from analysis.apps.makers.numbers import Decimals, frame_of
from analysis.apps.makers.points import Points, as_value
from analysis.apps.makers.program_machine import (
    HERE,
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
from analysis.apps.makers.programs.posture import agreeing, turns
from analysis.apps.makers.target import (
    NUMBER,
    Flags,
    Form,
    LineNumbers,
    Number,
    Parsed,
    ProgramTexts,
    Target,
    UncorrectedTarget,
    blanked,
    lines_of,
    with_newlines,
)
from analysis.correction.reasons import Reason
from analysis.robot.kinematics.arm import Arm, Array, Mask

_DECIMALS = Decimals(place=(3, 7), turn=(3, 9))
"""Decimals of corrected numbers. A controller prints three; whether it accepts more is unknown, so none are added."""
_BLANK = re.compile(
    r"(?<=:)[ \t]*(?:!|//|--eg:)[^\n]*|^[ \t]*(?:\d+[ \t]*)?:[ \t]*(?:!|//)[^\n]*|\"[^\"\n]*\"|MESSAGE\[[^\n]*",
    re.MULTILINE,
)
_LINE = re.compile(r"^[ \t]*(?:(?P<number>\d+)?[ \t]*:(?P<body>[^\n]*)|(?P<dashes>-{4,}))", re.MULTILINE)
_POINT = re.compile(r"(?<![A-Z])P\[\s*(\d{1,6})\s*(?::[^\]\n]{0,40})?\]")
_ANY_POINT = re.compile(r"(?<![A-Z])P\[\s*(?:(\d{1,6})\b|[^\]\n]{0,60})")
_POSITION = re.compile(r"\bP\[\s*(\d{1,6})\s*(?::[^\]\n]{0,40})?\]\s*\{([^{}]*)\}")
_MOVE = re.compile(
    rf"(?P<kind>[JLCAS])\s+(?P<point>PR?{INSIDE}|PAL_\w+{INSIDE})\s*(?P<second>PR?{INSIDE})?(?P<rest>.*)"
)
_OFFSET = re.compile(r"\b(?:Tool_)?Offset\b(?:\s*,\s*PR\[[^\]]*\])?|\bVOFFSET\b(?:\s*,\s*VR\[[^\]]*\])?", re.IGNORECASE)
_SKIP = re.compile(
    r"\bSkip\s*,\s*LBL\[\s*([^\]:]*)[^\]]*\](?:\s*,\s*(?P<register>PR\[.*?\]\s*=\s*[LJ]POS))?", re.IGNORECASE
)
_SEARCH = re.compile(r"\bSearch\s*\[[^\]]*\]", re.IGNORECASE)
_ALONG = re.compile(
    r"\b(?:TA|TB|DB|TIME\s+(?:BEFORE|AFTER))\s+[^,;]*,\s*"
    rf"(?P<action>P-SPS|POINT_LOGIC|CALL\s+[\w-]+(?:\s*\([^)]*\))?|[A-Z]+{INSIDE}\s*=\s*\S+)",
    re.IGNORECASE,
)
"""An action at a time before or after the arrival, or at a distance. Other options can follow it."""
_LOGIC = re.compile(r"\b(?:P-SPS|POINT_LOGIC)\b", re.IGNORECASE)
"""An action of several lines, which follow the move up to a line of dashes."""
_SELECTED = re.compile(r"(UFRAME_NUM|UTOOL_NUM)\s*(?:\[\s*GP1\s*\])?\s*=\s*(.*)", re.IGNORECASE)
"""Pattern of the selection of a frame.

A controller rejects a position if UF and UT differ from the selected numbers (INTP-250 to 253). A system variable can
disable this check ($FRM_CHKTYP, in some controllers $MCR.$UFRCHK). No source describes which number then applies, so
both have to agree.
"""
_FRAME = re.compile(r"(UFRAME|UTOOL)\s*\[\s*(?:GP\d\s*:\s*)?(.*?)\]\s*=.*", re.IGNORECASE)
_REGISTER = re.compile(r"PR\[\s*(?:GP1\s*:\s*)?((?:[^\[\]]|\[[^\[\]]*\])*)\]\s*=\s*(.*)")
_WHOLE = re.compile(r"PR\[\s*(?:GP1\s*:\s*)?(\d+)\s*(?::[^\]]*)?\]")
_CALL = re.compile(r"CALL\s+([\w-]+)\s*(?:\(.*\))?", re.IGNORECASE)
_RUN = re.compile(r"(?:RUN\s+|MONITOR\s+(?!END)|ERROR_PROG\s*=\s*|RESUME_PROG[^=]*=\s*)([\w-]+)", re.IGNORECASE)
_SYSTEM_FRAMES = re.compile(r"\$(?:MNUFRAME|MNUTOOL)", re.IGNORECASE)
_CONDITION = re.compile(r"(TOOL_)?OFFSET\s+CONDITION\b\s*(.*)", re.IGNORECASE)
_TRACKING = re.compile(r"\bLINE_TRACK|\bTRACK\b|TRACK_SCHEDULE")
_SCHEDULE = re.compile(r"TRACK_SCHEDULE_NUM\w*\s*:\s*(\w+)")
"""The conveyor of a listing. Controllers with the option write this header for each listing: 0 is no conveyor."""
_FRAMES = re.compile(r"UF\s*:\s*(\w+)\s*,\s*UT\s*:\s*(\w+)")
_CONFIG = re.compile(r"CONFIG\s*:\s*'\s*([FN])?\s*([UD])?\s*([TB])?\s*,\s*(-?\d+)\s*,\s*(-?\d+)\s*,\s*(-?\d+)\s*'")
_JOINT = re.compile(rf"\bJ([1-6])\s*=\s*({NUMBER})\s*deg")
_AXIS = re.compile(rf"\b([XYZWPR])\s*=\s*({NUMBER})\s*(?:mm|deg)")
_OTHER_AXIS = re.compile(rf"\b(E\d|J[7-9])\s*=\s*({NUMBER})")
"""An extended axis of the arm's group with the coordinate."""
_GROUP = re.compile(r"\bGP(\d)\s*:")
_ELBOW_RAD = np.radians(67.5)
"""Middle of the range of J2 + J3, the angle of the elbow, which turns less than a full turn: -70° to 205° of an LR Mate
200iD (ros-industrial/fanuc, lrmate200id_macro.xacro). No source states the range of other arms."""


@dataclass(frozen=True)
class _Line:
    """A statement with its first and last line, and the logic along a move."""

    text: str
    line: int
    last_line: int
    logic: tuple[_Line, ...] = ()


@dataclass(frozen=True)
class _Way:
    """The motion of a statement to a target: its kind, options without offsets, offsets, and the arc, if any."""

    kind: str
    options: str
    offsets: Sequence[str]
    arc: str = ""
    through: bool = False


@dataclass
class _FanucReader:
    names: tuple[str, ...]
    texts: tuple[str, ...]
    lines: tuple[LineNumbers, ...]
    points: Points
    programs: dict[str, list[int]] = field(default_factory=dict)
    routines: dict[str, tuple[Statement, ...]] = field(default_factory=dict)
    beside: list[Call] = field(default_factory=list)
    file: int = 0
    blocks: Blocks = field(default_factory=Blocks)
    labels: tuple[str, ...] = ()
    scope: str = ""
    """Prefix of the labels in the logic along a move, which can repeat those of the listing."""
    scopes: int = 0
    registers: tuple[int, ...] = ()
    macros: frozenset[str] = frozenset()
    """Macro instructions that change nothing, as stated by the user, in upper case."""
    conditions: frozenset[str] = frozenset()
    """Numbers of the registers in OFFSET CONDITION of any listing."""
    line: int = 0

    def why(self, fact: str) -> Unknown:
        return Unknown(self.file, self.line, " ".join(fact.split())[:80])

    def leave(self, line: int, name: str, reason: Reason) -> None:
        if self.file == 0:
            self.points.leave(UncorrectedTarget(0, line, name[:60], reason))

    def forget_conditions(self, fact: str) -> None:
        """Make the offsets of OFFSET CONDITION unknown, if a listing sets them."""
        if self.conditions:
            self.blocks.add(*(Set(part, self.why(fact)) for part in ("OFFSET CONDITION", "TOOL_OFFSET CONDITION")))

    def call_of(self, name: str) -> Statement:
        """Return the call of another program, or `ForgetAll` if the name is not unique or not known."""
        files = self.programs.get(name.upper(), [])
        why = self.why(f"{name} is called" if len(files) == 1 else f"{name} is unknown here")
        return Call(str(files[0]), why) if len(files) == 1 else ForgetAll(why)


def parse(texts: ProgramTexts) -> Parsed:
    """Parse the targets of a listing."""
    blank = tuple(blanked(with_newlines(text), _BLANK) for text in texts.texts)
    reader = _FanucReader(texts.names, blank, tuple(map(lines_of, blank)), Points(1))
    reader.macros = frozenset(name.upper() for name in texts.neutral)
    for file, text in enumerate(blank):
        named = re.search(r"^/PROG\s+([\w-]+)", text, re.MULTILINE)
        for name in {texts.names[file].rpartition(".")[0].upper(), *((named[1].upper(),) if named else ())}:
            reader.programs.setdefault(name, []).append(file)
    for name, files in reader.programs.items():
        if 0 in files:  # the program itself has priority
            reader.programs[name] = [0]
    for text in blank:
        for position in _POSITION.finditer(text, _section(text, "POS", len(text))):
            _, group = _arm_group(position[2]) or (0, "")
            reader.points.axes |= {axis for axis, coordinate in _others(group) if is_moved(coordinate)}
    start = _section(blank[0], "POS", len(blank[0]))
    for position in _POSITION.finditer(blank[0], start):
        target, reason = _position(position, reader.lines[0])
        reader.points.declare(position[1], target, reason)
    reader.registers = tuple({int(register[1]) for text in blank for register in _WHOLE.finditer(text)})
    reader.conditions = frozenset(re.findall(r"\bOFFSET\s+CONDITION\s+PR\[\s*(\w+)", "\n".join(blank)))
    for file in range(len(blank)):
        _read(reader, file)

    def initial(part: str) -> Value:
        family, _, number = part.partition("[")
        if part in ("UFRAME_NUM", "UTOOL_NUM"):
            return Unknown(0, 0, f"no line selects {part}")
        return number.rstrip("]") if family in ("UFRAME", "UTOOL") else OFF

    return reader.points.parsed(Program(reader.routines, initial, tuple(reader.beside), kept=("UFRAME[", "UTOOL[")))


def _section(text: str, name: str, otherwise: int, end: int | None = None) -> int:
    section = re.compile(rf"^/{name}\b", re.MULTILINE).search(text, 0, len(text) if end is None else end)
    return section.start() if section else otherwise


def _position(position: re.Match[str], lines: LineNumbers) -> tuple[Target, Reason | None]:
    number, group = position[1], _arm_group(position[2])
    line = lines.at(position.start())
    if group is None:
        return Target(f"P[{number}]", 0, line, "joints_deg", (), "F", "F"), "other_robot"
    begin, body = position.start(2) + group[0], group[1]
    joints = [(int(joint[1]), _number(joint, begin)) for joint in _JOINT.finditer(body)]
    axes = [("XYZWPR".index(component[1]) + 1, _number(component, begin)) for component in _AXIS.finditer(body)]
    form: Form = "joints_deg" if joints else "roll_pitch_yaw"
    by_axis = dict(joints or axes)
    numbers = tuple(by_axis[axis] for axis in sorted(by_axis))
    frames, config = _FRAMES.search(body), _CONFIG.search(body)
    flags = None
    if config and all(config[k] for k in (1, 2, 3)):
        letters = config[1] == "F", config[2] == "U", config[3] == "T"
        flags = Flags((*map(int, letters), *(int(config[k][:6]) for k in (4, 5, 6))), _agreeing)
    frame, tool = (frames[1], frames[2]) if frames else ("F", "F")
    external = tuple(_others(body))
    target = Target(f"P[{number}]", 0, line, form, numbers, tool, frame, flags, external=external)
    return target, None if len(numbers) == 6 and len(joints or axes) == 6 else "incomplete"


def _arm_group(body: str) -> tuple[int, str] | None:
    """Return the begin and the text of motion group 1 in a position; None if the position has only other groups."""
    groups = [*_GROUP.finditer(body)]
    if not groups:
        return 0, body
    ends = [*(group.start() for group in groups[1:]), len(body)]
    arm = ((group.end(), body[group.end() : end]) for group, end in zip(groups, ends, strict=True) if group[1] == "1")
    return next(arm, None)


def _others(text: str) -> Iterator[tuple[str, float]]:
    """Yield the extended axes in a group with their coordinates."""
    yield from ((axis[1], float(axis[2])) for axis in _OTHER_AXIS.finditer(text))


def _agreeing(arm: Arm, q: Array, values: tuple[int, ...], slack_rad: float) -> Mask:
    """Return a mask (n,) of the solutions q (n, 6) rad that agree with flip, up, front and the turns of axes 4 to 6,
    in the sense of `rig program`. CONFIG does not contain the turn of J3, whose range can exceed a full turn."""
    mask = agreeing(arm, q, values[:3], dict(zip((3, 4, 5), values[3:], strict=True)), turns, slack_rad)
    if arm.coupling[2, 1]:  # J3 is measured from the horizontal.
        mask &= np.abs(q[:, 1] + q[:, 2] - _ELBOW_RAD) <= np.pi
    return mask


def _number(component: re.Match[str], begin: int) -> Number:
    return Number(begin + component.start(2), begin + component.end(2), float(component[2]))


def _read(reader: _FanucReader, file: int) -> None:
    """Parse the instructions of a listing."""
    text = reader.texts[file]
    middle = _section(text, "POS", len(text))
    begin = _section(text, "MN", 0, middle)
    reader.file, reader.blocks, reader.line = file, Blocks(), 1
    reader.labels = tuple(re.findall(r"\bLBL\[\s*(\d+)", text[begin:middle]))
    schedule = _SCHEDULE.search(text, 0, begin)
    if _TRACKING.search(text, 0, begin) and not (schedule and schedule[1] == "0"):
        reader.blocks.add(Set("tracking", "on"))
    reader.forget_conditions("no line of this listing sets the offset")
    for line in _lines(text, begin, middle, reader.lines[file]):
        reader.line = line.line
        _statement(reader, line.text, line.last_line, line.logic)
    reader.routines[str(file)] = reader.blocks.finish_routine()


def _lines(text: str, begin: int, end: int, numbers: LineNumbers) -> list[_Line]:
    """Return the statements of a listing, the logic along a move with the move."""
    rows: list[_Line] = []
    for match in _LINE.finditer(text, begin, end):
        body, number = (match["body"] or match["dashes"] or "").strip(), numbers.at(match.start())
        if rows and match["body"] and not match["number"] and not rows[-1].text.endswith(";"):
            rows[-1] = replace(rows[-1], text=f"{rows[-1].text} {body}", last_line=number)
        else:
            rows.append(_Line(body, number, number))
    lines: list[_Line] = []
    in_logic = False
    for row in (replace(row, text=row.text.rstrip("; ")) for row in rows):
        move = _MOVE.fullmatch(row.text)
        if in_logic and not move:
            lines[-1] = replace(lines[-1], logic=(*lines[-1].logic, row))
            in_logic = not row.text.startswith("----")
        else:
            lines.append(row)
            in_logic = move is not None and _LOGIC.search(row.text) is not None
    return lines


def _statement(reader: _FanucReader, text: str, last_line: int, logic: tuple[_Line, ...] = ()) -> None:
    """Parse a statement that ends at `last_line`."""
    if move := _MOVE.fullmatch(text):
        _move(reader, move, last_line, logic)
        return
    _mentioned(reader, text)
    if not text or _flow(reader, text, last_line) or _sets(reader, text) or _POINT.match(text):
        return
    if text.upper() in reader.macros:
        return
    if change := change_by(text):
        reader.blocks.add(*(Set(part, value) for part, value in change.sets))
        if change.registers:
            _forget_registers(reader)
        return
    reader.blocks.add(ForgetAll(reader.why(f"{text} is unknown here")))
    if "LBL[" in text:
        reader.blocks.add(Jump(reader.labels, falls=True))


def _flow(reader: _FanucReader, text: str, last_line: int) -> bool:
    """Parse an instruction of flow control; False for any other instruction."""
    blocks = reader.blocks
    word = (re.match(r"[A-Za-z_]+", text) or [""])[0].upper()
    if word in ("IF", "ELSEIF", "SELECT", "ELSE", "FOR") or text.startswith("="):
        _branch(reader, text, word, last_line)
    elif word in ("ENDIF", "ENDFOR"):
        blocks.close()
    elif label := re.match(r"LBL\[\s*(\d+)", text):
        blocks.add(JumpTarget(reader.scope + label[1]))
    elif word in ("JMP", "WAIT", "VISION") and "LBL[" in text:
        blocks.add(Jump(_labels(reader, text), falls=word != "JMP"))
    elif word in ("END", "ABORT"):
        blocks.add(End(halts=word == "ABORT"))
    elif call := _CALL.fullmatch(text):
        blocks.add(reader.call_of(call[1]))
        reader.forget_conditions("a listing that is called may set the offset")
    elif run := _RUN.match(text):
        statement = reader.call_of(run[1])
        name = statement.name if isinstance(statement, Call) else f"{run[1]} "
        reader.beside.append(Call(name, reader.why(f"{run[1]} may run at any moment")))
    else:
        return False
    return True


def _sets(reader: _FanucReader, text: str) -> bool:
    """Parse an instruction that sets a frame, a register or a mode; False for any other instruction."""
    blocks, why = reader.blocks, reader.why(f"{text} sets it")
    if selected := _SELECTED.fullmatch(text):
        number = selected[2].strip()
        blocks.add(Set(selected[1].upper(), str(int(number)) if number.isdigit() else why))
    elif frame := _FRAME.fullmatch(text):
        family, number = frame[1].upper(), frame[2].split(":")[0].strip()
        value = _register(text.partition("=")[2], why)
        blocks.add(Set(f"{family}[{int(number)}]", value) if number.isdigit() else ForgetFamily(family, why))
    elif register := _REGISTER.fullmatch(text):
        _set_register(reader, register)
    elif _SYSTEM_FRAMES.match(text):
        blocks.add(
            ForgetFamily("UFRAME", why), ForgetFamily("UTOOL", why), Set("UFRAME_NUM", why), Set("UTOOL_NUM", why)
        )
    elif condition := _CONDITION.fullmatch(text):
        blocks.add(Set(f"{(condition[1] or '').upper()}OFFSET CONDITION", _register(condition[2], why)))
    else:
        return False
    return True


def _register(text: str, why: Unknown) -> Value | ComputedValue:
    """Return the frame in a position register; unknown unless the program has set all six numbers."""
    whole = _WHOLE.fullmatch(text.strip())
    if whole is None:
        return why

    def frame_from(values: tuple[Value, ...]) -> Value:
        numbers = [float(value) for value in values if isinstance(value, str) and re.fullmatch(NUMBER, value)]
        return as_value(frame_of("roll_pitch_yaw", numbers)) if len(numbers) == 6 else why

    return ComputedValue(tuple(f"PR{int(whole[1])}[{axis}]" for axis in range(1, 7)), frame_from)


def _set_register(reader: _FanucReader, assignment: re.Match[str]) -> None:
    """Parse an assignment to a position register, or to an element of it."""
    index, _, axis = assignment[1].partition(",")
    # The remark follows the last number: PR[5:base], PR[5,1:base]
    number, axis = (text.partition(":")[0].strip() for text in (index, axis))
    right = assignment[2].strip()
    right = right[1:-1].strip() if right.startswith("(") else right
    why = reader.why(f"{assignment[0]} sets it")
    if not number.isdigit():
        _forget_registers(reader)
        return
    register, copied = f"PR{int(number)}", _WHOLE.fullmatch(right)
    if number in reader.conditions:  # No manual states when the controller reads the register.
        reader.forget_conditions(f"{assignment[0]} sets it")
    if axis.isdigit():
        reader.blocks.add(Set(f"{register}[{axis}]", right if re.fullmatch(NUMBER, right) else why))
        return
    reader.blocks.add(ForgetFamily(register, why))
    if re.fullmatch(r"LPOS\s*-\s*LPOS", right):
        reader.blocks.add(*(Set(f"{register}[{component}]", "0") for component in range(1, 7)))
    elif copied and copied[1] != number:
        reader.blocks.add(*(Set(f"{register}[{k}]", Ref(f"PR{int(copied[1])}[{k}]")) for k in range(1, 7)))


def _forget_registers(reader: _FanucReader) -> None:
    why = reader.why("the line may set any position register")
    reader.blocks.add(*(ForgetFamily(f"PR{register}", why) for register in reader.registers))
    reader.forget_conditions("the line may set any position register")


def _labels(reader: _FanucReader, text: str) -> tuple[str, ...]:
    """Return the labels of a jump: all labels if the number is in a register."""
    named = tuple(re.findall(r"\bLBL\[\s*(\d+)\s*[\]:]", text))
    labels = reader.labels if re.search(r"\bLBL\[\s*[A-Za-z]", text) else named
    return tuple(dict.fromkeys((*labels, *(reader.scope + label for label in labels))))


def _branch(reader: _FanucReader, text: str, word: str, last_line: int) -> None:
    blocks = reader.blocks
    if word == "FOR":
        blocks.loop()
        blocks.may_leave()
    elif word == "ELSE" and "," not in text:
        blocks.other()
    elif re.search(r"\bTHEN$", text, re.IGNORECASE):
        if word == "ELSEIF":
            blocks.other()
            blocks.guard()
        else:
            blocks.branch()
    else:  # IF …, action; and the lines of SELECT
        depth, action = 0, ""  # The action follows the first comma outside brackets.
        for at, letter in enumerate(text):
            depth += (letter in "([") - (letter in ")]")
            if letter == "," and depth == 0:
                action = text[at + 1 :]
                break
        blocks.branch()
        _statement(reader, action.strip(), last_line)
        blocks.close()


def _mentioned(reader: _FanucReader, text: str) -> None:
    """Mark the points in an instruction as changed: all points if the number is in a register."""
    if reader.file:
        return
    for mention in _ANY_POINT.finditer(text):
        keys = [mention[1]] if mention[1] else list(reader.points.keys())
        for key in keys:
            if reader.points.knows(key):
                reader.points.change(key, 0, reader.line)


def _move(reader: _FanucReader, move: re.Match[str], last_line: int, logic: tuple[_Line, ...]) -> None:
    offsets, options = _OFFSET.findall(move["rest"]), _OFFSET.sub("", move["rest"])
    line, along, search = reader.line, _ALONG.search(options), _SEARCH.search(options)
    options = _SEARCH.sub("", _ALONG.sub("", options, count=1))
    skip = _SKIP.search(options)
    if skip:
        options = options[: skip.start()] + options[skip.end() :]
    # An action along the way may happen before or after the arm reaches the target.
    _action(reader, along, last_line, logic)
    reader.line = line
    for place, text in ((line, move["point"]), (last_line, move["second"])):
        if text:
            arc = f"arc at {line}" if move["second"] else ""
            _target(reader, text, place, _Way(move["kind"], options, offsets, arc, text == move["point"]))
    if skip:
        if register := _REGISTER.fullmatch(skip["register"] or ""):
            _set_register(reader, register)
        reader.blocks.add(Elsewhere(), Jump(_labels(reader, skip[0]), falls=True))
    elif search:  # The arm stops where it touches something.
        reader.blocks.add(Elsewhere())
    _action(reader, along, last_line, logic)


def _action(reader: _FanucReader, along: re.Match[str] | None, last_line: int, logic: tuple[_Line, ...]) -> None:
    """Parse the action along a move, which may already have happened or follow later."""
    if along is None:
        return
    reader.blocks.branch()
    if _LOGIC.fullmatch(along["action"]):
        reader.scopes += 1
        reader.scope = f"{reader.scopes}:"
        for row in logic:
            reader.line = row.line
            _statement(reader, row.text, row.last_line)
        reader.scope = ""
    else:
        _statement(reader, along["action"].strip(), last_line)
    reader.blocks.close()


def _offset(reader: _FanucReader, texts: Sequence[str]) -> tuple[str, Value | ComputedValue] | None:
    """Return the offset of a move: a register, in the user frame or in the tool; None if there is no offset."""
    if not texts:
        return None
    if len(texts) > 1:
        return "frame", reader.why("the move has several offsets")
    (text,) = texts
    why = reader.why("the offset is stored in the controller")
    register = re.fullmatch(r"(Tool_)?Offset(?:\s*,\s*(.*))?", text, re.IGNORECASE)
    if register is None:
        return "frame", why
    kind = "tool" if register[1] else "frame"
    if register[2]:
        return kind, _register(register[2], why)
    condition = f"{'TOOL_' if register[1] else ''}OFFSET CONDITION"
    return kind, ComputedValue((condition,), lambda values: why if values[0] == OFF else values[0])


def _unless_lost(values: tuple[Value, ...]) -> Value:
    """Return a part of the state, or OFF if a program that is not understood made everything unknown.

    A joint move to joint angles depends neither on tools, frames and registers nor on the position of the arm.
    """
    return OFF if isinstance(values[0], Unknown) and values[0].everything else values[0]


def _selected(number: str, values: tuple[Value, ...]) -> Value:
    """Return OFF if the number of a position is the selected number or F, else the selected number."""
    selected = values[0]
    return OFF if number in ("F", selected) else selected


def _target(reader: _FanucReader, text: str, line: int, way: _Way) -> None:
    point, blocks = _POINT.fullmatch(text), reader.blocks
    is_relative = re.search(r"\bINC\b", way.options, re.IGNORECASE) is not None
    if point is None or reader.file or not reader.points.knows(point[1]):
        literal = point is not None and not reader.file
        reader.leave(line, text, "not_literal" if literal else "computed")
        if point is None and text.startswith("P[") and not reader.file:
            _any_target(reader, line, way)
        blocks.add(Elsewhere(Unknown(reader.file, line, text[:80]) if reader.file and is_relative else None))
        return
    if is_relative:
        _mentioned(reader, text)
        reader.leave(line, text, "relative")
        blocks.add(Elsewhere())
        return
    options = way.options
    parts = {"external_tcp here": r"\bRTCP\b", "coordinated here": r"\bCOORD\b(?:\[[^\]]*\])?"}
    for part, pattern in parts.items():
        blocks.add(Set(part, "on" if re.search(pattern, options, re.IGNORECASE) else OFF))
        options = re.sub(pattern, "", options, flags=re.IGNORECASE)
    unknown = OPTIONS.sub("", options).strip(", ")
    blocks.add(Set("option here", reader.why(f"{unknown} is unknown here") if unknown else OFF))
    target = reader.points.target(point[1])
    tool, frame = (
        str(name) if name == "0" or not str(name).isdigit() else Ref(f"{family}[{name}]")
        for family, name in (("UTOOL", target.tool), ("UFRAME", target.frame))
    )
    needs: tuple[str, ...] = ("tracking", "shift", "option here", *parts)
    if target.joints and way.kind == "J":
        needs = (f"tracking{HERE}", f"shift{HERE}", "option here", *parts)
        blocks.add(*(Set(part, ComputedValue((part.removesuffix(HERE),), _unless_lost)) for part in needs[:2]))
    for part, number in () if target.joints else (("UFRAME_NUM", target.frame), ("UTOOL_NUM", target.tool)):
        blocks.add(Set(f"selected {part}{HERE}", ComputedValue((part,), partial(_selected, str(number)))))
        needs += (f"selected {part}{HERE}",)
    offset = _offset(reader, way.offsets)
    kind = "joint" if way.kind == "J" else "line"
    key = f"{point[1]}@{line}" if offset else point[1]
    base = point[1] if offset else ""
    blocks.add(Move(key, kind, 0, line, tool, frame, needs, None, None, offset, base, way.arc, through=way.through))


def _any_target(reader: _FanucReader, line: int, way: _Way) -> None:
    """Parse a move to a point selected by a register: any point is possible."""
    reader.blocks.cases()
    for key in tuple(reader.points.keys()):
        reader.blocks.other()
        reader.blocks.guard()
        _target(reader, f"P[{key}]", line, way)
    reader.blocks.close()


READER = ProgramReader(
    parse,
    _DECIMALS,
    Remark("{:4d}:  !", " ;", 32, {".ls": re.compile(rb"^/POS\b", re.MULTILINE)}),
    null_tools=("0",),
    null_frames=("0",),
    beside=(".ls",),
    empty="/PROG  {0}\n/MN\n/POS\n/END\n",
)
"""Reader of FANUC programs. Remarks have at most 32 characters (B-83284EN, 4.13); longer remarks take several lines."""
