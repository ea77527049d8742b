"""Reader of targets in listings of FANUC's teach pendant language (.LS): P[n] with joints, or a pose with CONFIG.

Source: FANUC, R-30iB Operator's Manual (Basic Operation) B-83284EN, chapter 4, and public backups in .LS. A position
contains the user frame UF and the tool frame UT. UF 0 is the world, assumed to be the robot's base as in the arms of
the library, and UT 0 is the flange. INC makes a move relative. Offset and Tool_Offset add a register stored in the
controller. A listing is a single program. Other listings in the directory are read if the program calls them.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial

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
_LINE = re.compile(r"^[ \t]*(?:(?P<number>\d+)[ \t]*)?:(?P<body>[^\n]*)", re.MULTILINE)
_POINT = re.compile(r"(?<![A-Z])P\[\s*(\d{1,6})\s*(?::[^\]\n]{0,40})?\]")
_ANY_POINT = re.compile(r"(?<![A-Z])P\[\s*(?:(\d{1,6})\b|[^\]\n]{0,60})")
_POSITION = re.compile(r"\bP\[\s*(\d{1,6})\s*(?::[^\]\n]{0,40})?\]\s*\{([^{}]*)\}")
_INSIDE = r"\[(?:[^\[\]]|\[[^\[\]]*\])*\]"
_MOVE = re.compile(rf"(?P<kind>[JLCAS])\s+(?P<point>PR?{_INSIDE})\s*(?P<second>PR?{_INSIDE})?(?P<rest>.*)")
_OFFSET = re.compile(r"\b(?:Tool_)?Offset\b(?:\s*,\s*PR\[[^\]]*\])?|\bVOFFSET\b(?:\s*,\s*VR\[[^\]]*\])?", re.IGNORECASE)
_SPEED = r"(?:\d+(?:\.\d*)?|\.\d+|A?R\[[^\]]*\])\s*(?:%|mm/sec|cm/min|inch/min|deg/sec|sec|msec)|max_speed|WELD_SPEED"
_OPTIONS = re.compile(
    rf"(?:{_SPEED}|FINE|CNT\s*(?:\d+|R\[[^\]]*\])|CD\s*\d+|CR\s*\d+|ACC\s*(?:\d+|R\[[^\]]*\])|DEC\s*\d+|Wjnt|PTH|MROT|"
    r"MINROT|BREAK|PSPD\s*\d+|EV\s*\d+\s*%|Ind\.EV\s*\d+\s*%|[;\s])",
    re.IGNORECASE,
)
"""Options after a target without influence on the position or the motion to it."""
_SKIP = re.compile(
    r"\bSkip\s*,\s*LBL\[\s*([^\]:]*)[^\]]*\](?:\s*,\s*(?P<register>PR\[.*?\]\s*=\s*[LJ]POS))?", re.IGNORECASE
)
_ALONG = re.compile(r"\b(?:TA|TB|DB|TIME\s+(?:BEFORE|AFTER))\s+[^,;]*,\s*(?P<action>[^;]*)", re.IGNORECASE)
_ASSIGNED = re.compile(
    r"(?:P|AR|R|SR|DO|DI|RO|RI|GO|GI|AO|AI|SO|SI|UO|UI|WO|WI|F|M|TIMER|VR|STR)"
    rf"{_INSIDE}\s*(?:,\s*\S+\s*)?=.*"
)
_NOTHING = re.compile(
    r"(?:OVERRIDE\s*=.*|PAYLOAD\s*\[.*|UALM\[.*|PAUSE|WAIT\b(?!.*TIMEOUT).*|MESSAGE\[.*|"
    r"U(?:FRAME|TOOL)_NUM\[\s*GP[2-9][^\]]*\]\s*=.*|JOINT_MAX_SPEED.*|LINEAR_MAX_SPEED.*|(?:TOOL_|V)?OFFSET\s+CONDITION\b.*|"
    r"SKIP\s+CONDITION\b.*|LOCK\s+(?:PREG|VREG)|UNLOCK\s+(?:PREG|VREG)|COL\s+(?:DETECT|GUARD)\b.*|RSR\[.*|REMARK\b.*|"
    r"Arc\s+(?:Start|End)\b.*|Weave\b.*|SPOT\s*\[.*|BACKUP\s*=.*|VISION\s+(?:RUN_FIND|GET_OFFSET|GET_PASSFAIL|"
    r"GET_NFOUND|CAMERA_CALIB|SET_REFERENCE|OVERRIDE)\b.*|LINECOUNT\[.*|LINESIM\[.*|SETTRIG\b.*|DEFENC\b.*|SETBOUND\b.*|"
    r"MONITOR\s+END.*|SELBOUND\b.*|DIAG_.*|FOLLOW\s+UP\b.*|CLEAR_RESUME_PROG|STRLEN\b.*|\$(?:WAITTMOUT|MCR\.\$GENOVERRIDE|"
    r"SCR\.\$\w+|PRGOVERRIDE|TIMER\[[^\]]*\]\S*)\s*=.*|--.*|)",
    re.IGNORECASE,
)
"""Instructions that change neither frames nor the position and motion of the arm: registers, signals, waiting,
speeds, messages, welding."""
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
_SWITCHES = (
    (re.compile(r"SOFTFLOAT\s+END.*", re.IGNORECASE), ("tracking", OFF)),
    (re.compile(r"SOFTFLOAT\b.*", re.IGNORECASE), ("tracking", "on")),
    (re.compile(r"Track\s+End.*", re.IGNORECASE), ("tracking", OFF)),
    (re.compile(r"Track\b.*", re.IGNORECASE), ("tracking", "on")),
)
_TRACKING = re.compile(r"\bLINE_TRACK|\bTRACK\b|TRACK_SCHEDULE", re.IGNORECASE)
_FRAMES = re.compile(r"UF\s*:\s*(\w+)\s*,\s*UT\s*:\s*(\w+)")
_CONFIG = re.compile(r"CONFIG\s*:\s*'\s*([FN])?\s*([UD])?\s*([TB])?\s*,\s*(-?\d+)\s*,\s*(-?\d+)\s*,\s*(-?\d+)\s*'")
_JOINT = re.compile(rf"\bJ([1-6])\s*=\s*({NUMBER})\s*deg")
_AXIS = re.compile(rf"\b([XYZWPR])\s*=\s*({NUMBER})\s*(?:mm|deg)")
_OTHERS = re.compile(r"\bGP[2-9]\b|\bE\d\s*=|\bJ[7-9]\s*=")
_OTHER_AXIS = re.compile(rf"\b(E\d|J[7-9])\s*=\s*({NUMBER})|\b(GP[2-9])\s*:(?=\s*(?:[^\]\s]|\n))")
"""An extended axis with the coordinate, or the positions of another group, which are not tracked."""


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
    registers: tuple[int, ...] = ()
    line: int = 0

    def why(self, fact: str) -> Unknown:
        return Unknown(self.file, self.line, " ".join(fact.split())[:80])

    def leave(self, line: int, name: str, reason: Reason) -> None:
        if self.file == 0:
            self.points.leave(UncorrectedTarget(0, line, name[:60], reason))

    def call_of(self, name: str) -> Statement:
        """Return the call of another program, or `ForgetAll` if the name is not unique or not known."""
        files = self.programs.get(name.upper(), [])
        why = self.why(f"{name} is called" if len(files) == 1 else f"{name} is unknown here")
        return Call(str(files[0]), why) if len(files) == 1 else ForgetAll(why)


def parse(texts: ProgramTexts) -> Parsed:
    """Parse the targets of a listing."""
    blank = tuple(blanked(with_newlines(text), _BLANK) for text in texts.texts)
    reader = _FanucReader(texts.names, blank, tuple(map(lines_of, blank)), Points(1))
    for file, text in enumerate(blank):
        named = re.search(r"^/PROG\s+([\w-]+)", text, re.MULTILINE)
        for name in {texts.names[file].rpartition(".")[0].upper(), *((named[1].upper(),) if named else ())}:
            reader.programs.setdefault(name, []).append(file)
    for name, files in reader.programs.items():
        if 0 in files:  # the program itself has priority
            reader.programs[name] = [0]
    for text in blank:
        positions = text[_section(text, "POS", len(text)) :]
        reader.points.axes |= {axis for axis, coordinate in _others(positions) if coordinate}
    start = _section(blank[0], "POS", len(blank[0]))
    for position in _POSITION.finditer(blank[0], start):
        target, reason = _position(position, reader.lines[0])
        reader.points.declare(position[1], target, reason)
    reader.registers = tuple({int(register[1]) for text in blank for register in _WHOLE.finditer(text)})
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
    number, body, begin = position[1], position[2], position.start(2)
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
    line = lines.at(position.start())
    target = Target(f"P[{number}]", 0, line, form, numbers, tool, frame, flags, external=external)
    if _OTHERS.search(body):
        return target, "external_axes"
    return target, None if len(numbers) == 6 and len(joints or axes) == 6 else "incomplete"


def _others(text: str) -> Iterator[tuple[str, float]]:
    """Yield the extended axes of positions with the coordinates. Other groups count as moved."""
    for axis in _OTHER_AXIS.finditer(text):
        yield (axis[3], 1.0) if axis[3] else (axis[1], float(axis[2]))


def _agreeing(arm: Arm, q: Array, values: tuple[int, ...], slack_rad: float) -> Mask:
    """Return a mask (n,) of the solutions q (n, 6) rad that agree with flip, up, front and the turns of axes 4 to 6,
    in the sense of `rig program`."""
    return agreeing(arm, q, values[:3], dict(zip((3, 4, 5), values[3:], strict=True)), turns, slack_rad)


def _number(component: re.Match[str], begin: int) -> Number:
    return Number(begin + component.start(2), begin + component.end(2), float(component[2]))


def _read(reader: _FanucReader, file: int) -> None:
    """Parse the instructions of a listing."""
    text = reader.texts[file]
    middle = _section(text, "POS", len(text))
    begin = _section(text, "MN", 0, middle)
    reader.file, reader.blocks, reader.line = file, Blocks(), 1
    reader.labels = tuple(re.findall(r"\bLBL\[\s*(\d+)", text[begin:middle]))
    if _TRACKING.search(text, 0, begin):
        reader.blocks.add(Set("tracking", "on"))
    statements: list[list[tuple[int, str]]] = []  # Each statement is a list of lines, as start and text.
    for line in _LINE.finditer(text, begin, middle):
        if line["number"] or not statements or statements[-1][-1][1].endswith(";"):
            statements.append([])
        statements[-1].append((line.start("body"), line["body"].strip()))
    for statement in statements:
        reader.line = reader.lines[file].at(statement[0][0])
        whole = " ".join(body for _, body in statement)
        _statement(reader, whole.rstrip("; "), reader.lines[file].at(statement[-1][0]))
    reader.routines[str(file)] = reader.blocks.finish_routine()


def _statement(reader: _FanucReader, text: str, last_line: int) -> None:
    """Parse an instruction that ends at `last_line`."""
    if move := _MOVE.fullmatch(text):
        _move(reader, move, last_line)
        return
    _mentioned(reader, text)
    if not (_flow(reader, text, last_line) or _sets(reader, text) or _NOTHING.fullmatch(text) or _POINT.match(text)):
        reader.blocks.add(ForgetAll(reader.why(f"{text} is unknown here")))


def _flow(reader: _FanucReader, text: str, last_line: int) -> bool:
    """Parse an instruction of flow control; False for any other instruction."""
    blocks = reader.blocks
    word = (re.match(r"[A-Za-z_]+", text) or [""])[0].upper()
    if word in ("IF", "ELSEIF", "SELECT", "ELSE", "FOR") or text.startswith("="):
        _branch(reader, text, word, last_line)
    elif word in ("ENDIF", "ENDFOR"):
        blocks.close()
    elif label := re.match(r"LBL\[\s*(\d+)", text):
        blocks.add(JumpTarget(label[1]))
    elif word in ("JMP", "WAIT", "VISION") and "LBL[" in text:
        blocks.add(Jump(_labels(reader, text), falls=word != "JMP"))
    elif word in ("END", "ABORT"):
        blocks.add(End(halts=word == "ABORT"))
    elif call := _CALL.fullmatch(text):
        blocks.add(reader.call_of(call[1]))
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
    elif switch := next((value for pattern, value in _SWITCHES if pattern.fullmatch(text)), None):
        blocks.add(Set(*switch))
    else:
        return _ASSIGNED.fullmatch(text) is not None
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
    right = assignment[2].strip().strip("()")
    why = reader.why(f"{assignment[0]} sets it")
    if not number.isdigit():
        reader.blocks.add(*(ForgetFamily(f"PR{register}", why) for register in reader.registers))
    elif axis.isdigit():
        reader.blocks.add(Set(f"PR{int(number)}[{axis}]", right if re.fullmatch(NUMBER, right) else why))
    else:
        reader.blocks.add(ForgetFamily(f"PR{int(number)}", why))


def _labels(reader: _FanucReader, text: str) -> tuple[str, ...]:
    """Return the labels of a jump: all labels if the number is in a register."""
    labels = tuple(re.findall(r"\bLBL\[\s*(\d+)\s*[\]:]", text))
    return reader.labels if re.search(r"\bLBL\[\s*[A-Za-z]", text) else labels


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


def _move(reader: _FanucReader, move: re.Match[str], last_line: int) -> None:
    options = move["rest"]
    along = _ALONG.search(options)
    if along:
        options = options[: along.start()]
        # An action along the way may happen before or after the arm reaches the target.
        reader.blocks.branch()
        _statement(reader, along["action"].strip(), last_line)
        reader.blocks.close()
    skip = _SKIP.search(options)
    if skip:
        options = options[: skip.start()] + options[skip.end() :]
    for place, text in ((reader.line, move["point"]), (last_line, move["second"])):
        if text:
            arc = f"arc at {reader.line}" if move["second"] else ""
            _target(reader, move["kind"], text, place, options, arc, through=text == move["point"])
    if skip:
        if register := _REGISTER.fullmatch(skip["register"] or ""):
            _set_register(reader, register)
        reader.blocks.add(Elsewhere(), Jump(_labels(reader, skip[0]), falls=True))
    if along:
        reader.blocks.branch()
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
    register = re.fullmatch(r"(Tool_)?Offset\s*,\s*(.*)", text, re.IGNORECASE)
    if register is None:
        return "frame", why
    return "tool" if register[1] else "frame", _register(register[2], why)


def _selected(number: str, values: tuple[Value, ...]) -> Value:
    """Return OFF if the number of a position is the selected number or F, else the selected number."""
    selected = values[0]
    return OFF if number in ("F", selected) else selected


def _target(
    reader: _FanucReader, kind: str, text: str, line: int, modifiers: str, arc: str = "", *, through: bool = False
) -> None:
    point, blocks = _POINT.fullmatch(text), reader.blocks
    is_relative = re.search(r"\bINC\b", modifiers, re.IGNORECASE) is not None
    if point is None or reader.file or not reader.points.knows(point[1]):
        literal = point is not None and not reader.file
        reader.leave(line, text, "not_literal" if literal else "computed")
        if point is None and not text.startswith("PR") and not reader.file:
            _any_target(reader, kind, line, modifiers)
        blocks.add(Elsewhere(Unknown(reader.file, line, text[:80]) if reader.file and is_relative else None))
        return
    if is_relative:
        _mentioned(reader, text)
        reader.leave(line, text, "relative")
        blocks.add(Elsewhere())
        return
    options = _OFFSET.sub("", modifiers)
    parts = {"external_tcp here": r"\bRTCP\b", "coordinated here": r"\bCOORD\b(?:\[[^\]]*\])?"}
    for part, pattern in parts.items():
        blocks.add(Set(part, "on" if re.search(pattern, options, re.IGNORECASE) else OFF))
        options = re.sub(pattern, "", options, flags=re.IGNORECASE)
    unknown = _OPTIONS.sub("", options).strip(", ")
    blocks.add(Set("option here", reader.why(f"{unknown} is unknown here") if unknown else OFF))
    target = reader.points.target(point[1])
    tool, frame = (
        str(name) if name == "0" or not str(name).isdigit() else Ref(f"{family}[{name}]")
        for family, name in (("UTOOL", target.tool), ("UFRAME", target.frame))
    )
    needs = ("tracking", "option here", *parts)
    for part, number in () if target.joints else (("UFRAME_NUM", target.frame), ("UTOOL_NUM", target.tool)):
        blocks.add(Set(f"selected {part}{HERE}", ComputedValue((part,), partial(_selected, str(number)))))
        needs += (f"selected {part}{HERE}",)
    offset = _offset(reader, _OFFSET.findall(modifiers))
    way = "joint" if kind == "J" else "line"
    key = f"{point[1]}@{line}" if offset else point[1]
    base = point[1] if offset else ""
    blocks.add(Move(key, way, 0, line, tool, frame, needs, None, None, offset, base, arc, through=through))


def _any_target(reader: _FanucReader, kind: str, line: int, modifiers: str) -> None:
    """Parse a move to a point selected by a register: any point is possible."""
    reader.blocks.cases()
    for key in tuple(reader.points.keys()):
        reader.blocks.other()
        reader.blocks.guard()
        _target(reader, kind, f"P[{key}]", line, modifiers)
    reader.blocks.close()


READER = ProgramReader(
    parse,
    _DECIMALS,
    Remark("{:4d}:  !", " ;", 32, {".ls": re.compile(rb"^/POS\b", re.MULTILINE)}),
    null_tools=("0",),
    null_frames=("0",),
    beside=(".ls",),
)
"""Reader of FANUC programs. Remarks have at most 32 characters (B-83284EN, 4.13); longer remarks take several lines."""
