"""Reader of targets in G-code of LinuxCNC for arms with genserkins.

Source: LinuxCNC 2.9, G-code reference, O-codes and Switchable Kinematics. A target is a G0 or G1, or a G2 or G3 with R,
with all of X Y Z A B C as numbers in mm and degrees. G0 and G1 are straight lines, in the second kinematics (M68 E3 Q1)
joint moves. A word that a line omits keeps its value: a target is not corrected if a later line takes words from it.

A work offset shifts X, Y and Z, and adds to A, B and C, which is no rotation of a frame: only shifts are known frames.
Tool lengths (G43) shift in the world and not along the tool. The pose is that of the last frame of genserkins.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from analysis.apps.makers.numbers import Decimals
from analysis.apps.makers.points import Points, as_value
from analysis.apps.makers.program_machine import (
    OFF,
    Blocks,
    Call,
    ComputedValue,
    Elsewhere,
    End,
    ForgetAll,
    Move,
    Program,
    Set,
    Statement,
    Unknown,
    Value,
    usages_of,
)
from analysis.apps.makers.program_reader import ProgramReader, Remark
from analysis.apps.makers.target import (
    NUMBER,
    NamedFrame,
    Notice,
    Number,
    Parsed,
    ProgramTexts,
    Target,
    Way,
    blanked,
    lines_of,
    with_newlines,
)
from analysis.correction.reasons import Reason

_DECIMALS = Decimals(place=(4, 7), turn=(5, 9))
_BLANK = re.compile(r";[^\n]*|\([^()\n]*\)|^[ \t]*%[^\n]*", re.MULTILINE)
_LINE = re.compile(r"^[^\n]*$", re.MULTILINE)
_FLOW = re.compile(r"[oO]\s*(?P<name>\d+|<[^>]*>|\[[^\n]*?\]|#\S+?)\s*(?P<word>[a-zA-Z]+)(?P<rest>.*)")
_WORD = re.compile(rf"(?P<letter>[a-zA-Z])[ \t]*(?:(?P<number>{NUMBER})|(?P<computed>[-+]?(?:\[|#)))")
_ASSIGNED = re.compile(r"(?:#\s*(?:\d+|<[^>]*>)\s*=[^#=]*(?:#[^=]*)?)+")
_SYSTEM = re.compile(r"#\s*(?:5[0-9]{3}|#|\[)[^=]*=")
"""Assignment to a parameter of the interpreter, such as a work offset (5221 to 5390), or to a computed one."""
_TURNS = re.compile(r"([ABC])\[360 \* ROUND\[[^\n]*?\] / 360\]\]")
"""Whole turns as the offset of an angle, as `rig program` writes them."""
_AXES, _OTHERS = "XYZABC", "UVW"
_SYSTEMS = {54: 1, 55: 2, 56: 3, 57: 4, 58: 5, 59: 6, 59.1: 7, 59.2: 8, 59.3: 9}
_SYSTEM_NAMES = tuple(f"G{code:g}" for code in _SYSTEMS)
_NOTHING_G = {4, 17, 18, 19, 61, 61.1, 64, 80, 90.1, 91.1, 93, 94, 95, 96, 97, 98, 99, 28.1, 30.1, 8, 7}
_NOTHING_M = {0, 1, 3, 4, 5, 7, 8, 9, 19, 48, 49, 50, 51, 52, 53, 60, 61, 62, 63, 64, 65, 66, 67, 70, 71, 73}
"""Codes that change neither position nor offsets nor the meaning of numbers."""
_SWITCHES: dict[float, tuple[str, Value]] = {
    20: ("switch units", "inch"), 21: ("switch units", OFF), 90: ("switch distance", OFF),
    91: ("switch distance", "relative"), 40: ("shift radius", OFF), 41: ("shift radius", "on"),
    41.1: ("shift radius", "on"), 42: ("shift radius", "on"), 42.1: ("shift radius", "on"), 43: ("shift tool", "on"),
    43.1: ("shift tool", "on"), 43.2: ("shift tool", "on"), 49: ("shift tool", OFF), 92: ("shift G92", "on"),
    92.1: ("shift G92", OFF), 92.2: ("shift G92", OFF), 92.3: ("shift G92", "on"),
}  # fmt: skip
_LATER = {
    "shift radius": r"G\s*4[12]", "shift tool": r"G\s*43", "shift G92": r"G\s*92(?!\.[12])",
    "switch poses": r"E\s*3|M\s*(?:128|129|130|428|429|430)|G\s*1[23]\.1",
}  # fmt: skip
"""Patterns of codes that make the initial value of a part unknown: the controller keeps values between programs."""
_POSES, _JOINTS = "switch poses", "switch joints"
_KEEPS = "posture of the way"
"""Name of a part of the state that is always off: the arm keeps its posture along a line."""
_MOVES = {0, 1, 2, 3}


def _selected(values: tuple[Value, ...]) -> Value:
    """Return the numbers or the name of the selected work offset."""
    system, *offsets = values
    return offsets[_SYSTEM_NAMES.index(system)] if isinstance(system, str) else system


_SYSTEM_FRAME = ComputedValue(("system", *(f"offset[{name}]" for name in _SYSTEM_NAMES)), _selected)


@dataclass
class _Reader:
    text: str
    points: Points = field(default_factory=lambda: Points(1))
    blocks: Blocks = field(default_factory=Blocks)
    routines: dict[str, tuple[Statement, ...]] = field(default_factory=dict)
    outer: list[Blocks] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    broken: list[Call] = field(default_factory=list)
    motion: float | None = None
    """Code of the last move; None if unknown."""
    relative: bool = False
    joints: bool = False
    """Whether numbers are joint angles, in the order of the lines."""
    partial: set[str] = field(default_factory=set)
    """Keys of moves that take words from the previous position."""
    centred: set[str] = field(default_factory=set)
    """Keys of arcs with a centre, which is relative to the start."""
    line: int = 0

    def why(self, fact: str) -> Unknown:
        return Unknown(0, self.line, " ".join(fact.split())[:80])


def parse(texts: ProgramTexts) -> Parsed:
    """Parse the targets of a program."""
    text = blanked(with_newlines(texts.texts[0]), _BLANK)
    reader, numbers = _Reader(text), lines_of(text)
    for line in _LINE.finditer(text):
        reader.line = numbers.at(line.end())
        _read(reader, line[0], line.start())
    if reader.names or reader.blocks.depth:
        reader.broken.append(Call("\0", reader.why("a block does not end")))
    while reader.names:
        _end_routine(reader)
    reader.routines[""] = reader.blocks.finish_routine()
    program = Program(reader.routines, _initial(text), tuple(reader.broken), kept=("offset[",), starts="")
    _leave_sources(reader, program)
    if offset := re.search(r"[gG]\s*5[4-9]", text):
        fact = "a work offset given by --frame must only shift: LinuxCNC adds A, B and C to the numbers of the pose"
        reader.points.notices.append(Notice(0, numbers.at(offset.start()), fact))
    return reader.points.parsed(program)


def _initial(text: str) -> Callable[[str], Value]:
    unknown = {part for part, codes in _LATER.items() if re.search(codes, text, re.IGNORECASE)}

    def initial(part: str) -> Value:
        if part in ("switch units", "switch distance"):
            return Unknown(0, 0, f"no line before selects the {part.removeprefix('switch ')}")
        if part == "system":
            return "G54"  # each program starts with it
        if part in unknown:
            return Unknown(0, 0, "a previous program may have left it on")
        family, _, number = part.partition("[")
        return number.rstrip("]") if family == "offset" else "on" if part == _JOINTS else OFF

    return initial


def _leave_sources(reader: _Reader, program: Program) -> None:
    """Mark the points from which an incomplete line takes words, and the starts of arcs with a centre."""
    sources: dict[str, set[str]] = {}
    for usage in usages_of(program):
        sources.setdefault(usage.move.key, set()).update(key for key in usage.comes_from if key)
    for first in reader.partial | reader.centred:
        todo, seen = [first], set[str]()
        while todo:
            key = todo.pop()
            for source in sources.get(key, ()):
                if reader.points.knows(source) and source not in seen:
                    seen.add(source)
                    reader.points.change(source, 0, reader.points.target(first).line)
                    if source in reader.partial:
                        todo.append(source)


def _read(reader: _Reader, text: str, begin: int) -> None:
    """Parse a line."""
    line = text.strip()
    if flow := _FLOW.fullmatch(line):
        _flow(reader, flow["name"].lower(), flow["word"].lower(), flow["rest"])
    elif line.startswith("/"):
        reader.blocks.branch()
        _read(reader, " " * (text.index("/") + 1) + line[1:], begin)
        reader.blocks.close()
    elif line.startswith("#"):
        if _SYSTEM.search(line) or not _ASSIGNED.fullmatch(line):
            reader.blocks.add(ForgetAll(reader.why(f"{line} sets it")))
    elif line:
        _codes(reader, text, begin)


def _flow(reader: _Reader, name: str, word: str, rest: str) -> None:
    """Parse an o-word. The modal motion is unknown after any of them, because paths join."""
    blocks = reader.blocks
    reader.motion = None
    match word:
        case "sub":
            reader.outer.append(reader.blocks)
            reader.names.append(name)
            reader.blocks = Blocks()
        case "endsub" if reader.names:
            _end_routine(reader)
        case "call":
            blocks.add(Call(name, reader.why(f"o{name} is called")))
        case "return":
            blocks.add(End())
        case "if":
            blocks.branch()
        case "elseif":
            blocks.other()
            blocks.guard()
        case "else":
            blocks.other()
        case "while" | "repeat" if rest.strip():
            blocks.loop()
            blocks.may_leave()
        case "endif" | "endwhile" | "endrepeat" if blocks.depth:
            blocks.close()
        case "break":
            blocks.leave()
        case "continue":
            blocks.again()
        case _:  # the loop do … while has its condition at the end
            reader.broken.append(Call("\0", reader.why(f"{word} is unknown here")))


def _end_routine(reader: _Reader) -> None:
    name = reader.names.pop()
    reader.routines[name] = reader.blocks.finish_routine()
    reader.blocks = reader.outer.pop()


@dataclass(frozen=True)
class _Block:
    """Words of a line: codes of G and M, and numbers of the other letters, None if computed."""

    g: tuple[float, ...]
    m: tuple[float, ...]
    values: dict[str, Number | None]


def _block(text: str, begin: int) -> _Block | None:
    """Return the words of a line; None if it has other text."""
    plain = _TURNS.sub(lambda turns: f"{turns[1]}0" + " " * (len(turns[0]) - 2), text)
    g, m, values, at = list[float](), list[float](), dict[str, Number | None](), 0
    while at < len(plain):
        if plain[at].isspace():
            at += 1
            continue
        word = _WORD.match(plain, at)
        if word is None:
            return None
        letter, at = word["letter"].upper(), word.end()
        if word["computed"]:
            at = _expression_end(plain, word.start("computed"))
            if at == 0:
                return None
            values[letter] = None
        elif letter == "G":
            g.append(float(word["number"]))
        elif letter == "M":
            m.append(float(word["number"]))
        else:
            place = begin + word.start("number")
            values[letter] = Number(place, begin + word.end("number"), float(word["number"]))
    return _Block(tuple(g), tuple(m), values)


def _expression_end(text: str, at: int) -> int:
    """Return the end of an expression in brackets, or of a parameter, that starts at a place; 0 if it has no end."""
    at += text[at] in "+-"
    if text[at] == "#":
        named = re.compile(r"#+(?:<[^>]*>|\d+)").match(text, at)
        return named.end() if named else _expression_end(text, at + 1) if text[at + 1 : at + 2] == "[" else 0
    depth = 0
    for place in range(at, len(text)):
        depth += (text[place] == "[") - (text[place] == "]")
        if depth == 0:
            return place + 1
    return 0


def _codes(reader: _Reader, text: str, begin: int) -> None:
    """Parse a line of codes: first the changes of the state, then the motion."""
    block = _block(text, begin)
    if block is None:
        reader.blocks.add(ForgetAll(reader.why(f"{text.strip()} is unknown here")))
        return
    reader.blocks.add(*_states(reader, block))
    moves = [code for code in block.g if code in _MOVES]
    if moves:
        reader.motion = moves[0]
    elif 80 in block.g:
        reader.motion = None
    has_axes = any(letter in block.values for letter in _AXES + _OTHERS)
    without_motion = any(code in (10, 92, 28, 30, 28.1, 30.1, 52, 43.1) for code in block.g)
    if has_axes and not without_motion:
        _motion(reader, block)
    if 2 in block.m or 30 in block.m:
        reader.blocks.add(End(halts=True))


def _states(reader: _Reader, block: _Block) -> Iterator[Statement]:
    """Yield the changes of the state by the codes of a line."""
    for code in block.g:
        if code in _SWITCHES:
            part, value = _SWITCHES[code]
            if part == "switch distance":
                reader.relative = code == 91
            yield Set(part, value)
        elif code in _SYSTEMS:
            yield Set("system", f"G{code:g}")
        elif code == 10:
            yield from _offset(reader, block)
        elif code in (28, 30, 38.2, 38.3, 38.4, 38.5):
            yield Elsewhere()
        elif code not in _NOTHING_G | _MOVES | {53}:
            yield ForgetAll(reader.why(f"G{code:g} is unknown here"))
    for code in block.m:
        if code == 68:
            yield from _analog(reader, block)
        elif code == 6:
            yield Elsewhere()
        elif code not in _NOTHING_M | {2, 30}:
            yield ForgetAll(reader.why(f"M{code:g} is unknown here"))


def _analog(reader: _Reader, block: _Block) -> Iterator[Statement]:
    """Yield the change of the kinematics by analog output 3."""
    output, value = block.values.get("E"), block.values.get("Q")
    if output and output.value != 3:
        return
    if output is None or value is None or value.value not in (0, 1):
        yield ForgetAll(reader.why("the kinematics are computed, or of the user"))
        return
    reader.joints = value.value == 1
    yield Set(_POSES, "on" if reader.joints else OFF)
    yield Set(_JOINTS, OFF if reader.joints else "on")


def _offset(reader: _Reader, block: _Block) -> Iterator[Statement]:
    """Yield the work offset set by G10 L2. It is known if all numbers are given, and it only shifts."""
    kind, system = block.values.get("L"), block.values.get("P")
    if not kind or not system or kind.value != 2 or system.value not in _SYSTEMS.values():
        yield ForgetAll(reader.why("G10 sets offsets that rig does not follow"))
        return
    name = next(f"G{code:g}" for code, number in _SYSTEMS.items() if number == system.value)
    given = [block.values.get(letter) for letter in (*_AXES, "R")]
    value: Value = reader.why("G10 sets an offset that is computed or does not only shift")
    if all(given) and not any(number.value for number in given[3:] if number):
        T = np.eye(4)
        T[:3, 3] = [number.value for number in given[:3] if number]
        value = as_value(T)
        reader.points.state(NamedFrame(name, "frame", 0, reader.line, value))
    yield Set(f"offset[{name}]", value)


def _motion(reader: _Reader, block: _Block) -> None:
    """Parse a motion to the numbers of a line."""
    numbers = [block.values.get(letter) for letter in _AXES]
    name = "G?" if reader.motion is None else f"G{reader.motion:g}"
    reason = _reason(reader, block, numbers)
    key = f"line {reader.line}"
    known = [number for number in numbers if number]
    frame = "G53" if 53 in block.g else _SYSTEM_FRAME
    joints = reader.joints
    target = Target(name, 0, reader.line, "joints_deg" if joints else "roll_pitch_yaw", tuple(known), "flange", "G54")
    reader.points.declare(key, target, reason)
    if reason in ("incomplete", "relative", "computed"):
        reader.partial.add(key)
    if reason == "arc_centre":
        reader.centred.add(key)
    way: Way = "joint" if joints else "line"
    needs = (
        "switch units",
        "switch distance",
        _JOINTS if joints else _POSES,
        *(part for part in _LATER if part[:5] == "shift"),
    )
    if joints:  # joints are in the unit of the machine
        needs = needs[1:]
    reader.blocks.add(Move(key, way, 0, reader.line, "flange", frame, needs, None if joints else _KEEPS))


def _reason(reader: _Reader, block: _Block, numbers: Sequence[Number | None]) -> Reason | None:
    """Return the reason for which the target of a line cannot be corrected."""
    values = block.values
    reasons: dict[Reason, bool] = {
        "not_understood": reader.motion is None,
        "external_axes": any(letter in values for letter in _OTHERS),
        "relative": reader.relative,
        "computed": any(letter in values and values[letter] is None for letter in _AXES),
        "incomplete": not all(numbers),
        "arc_centre": reader.motion in (2, 3) and "R" not in values,
    }
    return next((reason for reason, applies in reasons.items() if applies), None)


READER = ProgramReader(parse, _DECIMALS, Remark("; "), null_tools=("flange",), null_frames=("G53",))
