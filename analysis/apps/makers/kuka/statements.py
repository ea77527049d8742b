"""Effects of KRL statements on tool, base and arm: the closed list of the dialect.

Source: KUKA System Software 8.x, Operating and Programming Instructions for System Integrators. BAS(#PTP_PARAMS),
BAS(#CP_PARAMS) and BAS(#FRAMES) use tool, base and interpolation frame of FDAT_ACT; BAS(#TOOL, n) and BAS(#BASE, n) use
the lists. BAS(#INITMOV) sets the values in the controller's bas.src. IR_STOPM handles stops and appears in every
program of the pendant. SET_CD_PARAMS and USE_CM_PRO_VALUES set the sensitivity of collision detection and appear in
every inline form of KSS 8.5 and newer.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from analysis.apps.makers.external_axes import is_moved
from analysis.apps.makers.kuka.closed_lists import (
    CORRECTIONS,
    NOTHING,
    SYSTEM,
    effect_of,
    is_file_of_maker,
)
from analysis.apps.makers.kuka.copies import part_of, read_copy, set_copy
from analysis.apps.makers.kuka.posture import agreeing, agreeing_status, agreeing_turn
from analysis.apps.makers.numbers import frame_of, is_frame
from analysis.apps.makers.points import Points, as_value
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
    Ref,
    Set,
    Statement,
    Unknown,
    Value,
)
from analysis.apps.makers.target import (
    NUMBER,
    Agreeing,
    Flags,
    Form,
    LineNumbers,
    NamedFrame,
    Notice,
    Number,
    Target,
    UncorrectedTarget,
    arguments,
    brackets,
    words,
)
from analysis.correction.reasons import Reason
from analysis.robot.kinematics.arm import Array

CORRECTION = "correction of bas.src"
"""Name of the part that is off unless tools and bases of inline forms are displaced by TOOL_CORR or BASE_CORR."""
LINES = "flags of lines"
"""Name of the part with the validity of posture flags at the end of a line. A line or an arc keeps the posture at the
start and ignores the flags, so the path has to lead to the same posture. A single flag is not compared."""
_EXTERNAL_MOVED = re.compile(
    rf"(?<![\w$.])(E[1-6])\s+({NUMBER})|\.\s*(E[1-6])\b|\bASYPTP\b|\$EX_AX_\w+|\$ASYNC_\w+", re.IGNORECASE
)
"""Pattern of a text that moves or assigns an external axis."""
LITERAL_TYPE = re.compile(r"^\s*(?:E6POS|POS|FRAME|E6AXIS|AXIS)\s*:", re.IGNORECASE)
"""The type before the numbers of an aggregate, {E6POS: X …}."""

_AGREEING: dict[tuple[str, ...], Agreeing] = {("S", "T"): agreeing, ("S",): agreeing_status, ("T",): agreeing_turn}
"""Flags by the stated parts. The controller takes the stated part; the other part depends on the moves before, so a
target with one part is corrected only if this part identifies the solution."""
_AXES = tuple(f"A{axis}" for axis in range(1, 7))
_POSE = ("X", "Y", "Z", "A", "B", "C")
_EXTERNAL = tuple(f"E{axis}" for axis in range(1, 7))
_COMPONENT = re.compile(rf"\s*([A-Z]\w*)\s+({NUMBER}|'B[01]{{1,16}}'|'H[0-9A-F]{{1,8}}')\s*", re.IGNORECASE)
_WORD = re.compile(r"[A-Za-z_]\w*")
_CALL = re.compile(r"(?<![\w$.#])([A-Za-z_]\w*)\s*\(")
_MOVE = re.compile(r"\s*(?P<kind>S?PTP|S?LIN|S?CIRC|SPL)(?P<relative>_REL)?\s+(?!=)(?P<rest>.+)", re.IGNORECASE)
_BARE = re.compile(r"\s*(?P<kind>S?PTP|S?LIN|S?CIRC|SPL)(?P<relative>_REL)?\s*(?P<rest>\{.+)", re.IGNORECASE)
_ARC_MOVES_AXES = "an arc of a given angle may end at different coordinates of the external axes"
_WITH = re.compile(r"\sWITH\s(.*)", re.IGNORECASE)
_SPLINE = re.compile(r"\s*(?:PTP_SPLINE|SPLINE|ENDSPLINE)\b", re.IGNORECASE)
_WITH_PART = re.compile(r"\$(TOOL|BASE|IPO_MODE)\s*=\s*((?:[^,()]|\([^()]*\))*)", re.IGNORECASE)
_WITH_FDAT = re.compile(r"S(?:TOOL2?|BASE|IPO_MODE)\s*\(\s*(\w+)(?:\.\w+)?\s*\)", re.IGNORECASE)
_ENDS = re.compile(r"\s(?:C_DIS|C_PTP|C_VEL|C_ORI|C_SPL)\b.*", re.IGNORECASE)
_CONSTANT = re.compile(r"\bORI_TYPE?\s*=?\s*#CONST", re.IGNORECASE)
"""Pattern of a line that keeps the orientation at the start, regardless of the target."""
_STAYS = re.compile(r"\$(?:AXIS|POS)_ACT(?:_MES)?\s*(?:C_\w+\s*)*", re.IGNORECASE)
_ELEMENT = re.compile(r"\s*\[\s*(\d+)\s*\]")
_INDEX = r"\[(?:[^\[\]]|\[[^\[\]]*\])*\]"
_ASSIGNED = re.compile(rf"\s*(?P<left>\$?[A-Za-z_][\w$]*(?:\s*{_INDEX})?(?:\.\w+(?:{_INDEX})?)*)\s*=(?!=)(?P<right>.*)")
_CYCLICAL = re.compile(r"\s*\$CYCFLAG\b", re.IGNORECASE)
"""Variables whose right side is evaluated repeatedly in the background."""
_BY_NUMBER = re.compile(r"(TOOL_DATA|BASE_DATA)\s*\[\s*(\d+)\s*\]", re.IGNORECASE)
_AGGREGATE = re.compile(r"\{([^{}]*)\}")
_HANDED = re.compile(
    r"\b(?:TOOL_DATA|BASE_DATA|FDAT_ACT)\b|\$(?:TOOL|BASE|IPO_MODE|ORI_TYPE)\b(?!\s*=(?!=))", re.IGNORECASE
)
"""The motion settings that a call may write to if they are passed to it."""
_PARTS_OF = {
    "$TOOL": ("tool",), "$BASE": ("base",), "$IPO_MODE": ("external_tcp",), "$ORI_TYPE": ("switch",),
    "FDAT_ACT": ("fdat tool", "fdat base", "fdat ipo", "tool", "base"),
}  # fmt: skip
_BAS = re.compile(r"\s*BAS\s*\(\s*#(\w+)\s*(?:,([^()]*))?\)\s*", re.IGNORECASE)
_ROUTINE = re.compile(r"\s*(?:GLOBAL\s+)?(?:DEF|DEFFCT\s+\w+(?:\s*\[[^\]]*\])?)\s+(\w+)\s*\(", re.IGNORECASE)
_BESIDE = re.compile(r"\s*(?:(?:GLOBAL\s+)?INTERRUPT\s+DECL\b|TRIGGER\s+WHEN\b).*?\bDO\b(.*)", re.IGNORECASE)
_LABEL = re.compile(r"\s*([A-Za-z_]\w*)\s*:\s*")
_DECLARATION = re.compile(
    r"\s*(?:(?:DECL|INT|REAL|BOOL|CHAR|E6POS|E6AXIS|FRAME|POS|AXIS|STRUC|ENUM|SIGNAL|EXT|EXTFCT|EXTP|IMPORT|CHANNEL|"
    r"GLOBAL|CONST|DEFDAT|ENDDAT)\b.*|)",
    re.IGNORECASE,
)
_BAS_NOTHING = words("VEL_PTP VEL_CP ACC_PTP ACC_CP ACC_GLUE PTP_DAT CP_DAT OUT_SYNC OUT_ASYNC NONE INIT VEL_ACC GROUP")


@dataclass
class KrlReader:
    """State of a program during parsing, with names in upper case."""

    names: tuple[str, ...]
    texts: tuple[str, ...]
    lines: tuple[LineNumbers, ...]
    points: Points
    fdat: dict[str, str] = field(default_factory=dict)
    fdat_written: set[str] = field(default_factory=set)
    spent: set[tuple[int, int]] = field(default_factory=set)
    routines: dict[str, tuple[Statement, ...]] = field(default_factory=dict)
    beside: list[Call] = field(default_factory=list)
    blocks: Blocks | None = None
    routine: str = ""
    arrays: dict[str, list[str]] = field(default_factory=dict)
    """Keys of the elements with numbers of an array of points."""
    copies: dict[str, str] = field(default_factory=dict)
    """Copies of points in the current module."""
    constants: dict[str, float] = field(default_factory=dict)
    spline: dict[str, Value | Ref | ComputedValue] = field(default_factory=dict)
    """Settings in the head of a spline, valid for all segments."""
    _defined: dict[str, list[str]] = field(default_factory=dict)

    @cached_property
    def constant(self) -> bool:
        """True if any motion data of the program keep the orientation constant."""
        return any(_CONSTANT.search(text) for text in self.texts)

    @cached_property
    def modules(self) -> tuple[str, ...]:
        """The module of each file: its path without suffix, in upper case."""
        return tuple(name.rpartition(".")[0].upper() for name in self.names)

    def module_texts(self, file: int) -> list[str]:
        """Return the texts of the module of a file: program and data list."""
        pairs = zip(self.modules, self.texts, strict=True)
        return [text for module, text in pairs if module == self.modules[file]]

    def is_config(self, file: int) -> bool:
        """Return whether a file is $config.dat, whose data are visible everywhere."""
        return self.modules[file].rpartition("/")[2] == "$CONFIG"

    def is_of_maker(self, file: int) -> bool:
        """Return whether the maker delivers a file."""
        return file >= self.points.files and is_file_of_maker(self.names[file])

    def scoped(self, file: int, name: str, *, is_shared: bool) -> str:
        """Return the key of a declared point or FDAT, which other modules see only if it is shared."""
        return name.upper() if is_shared else f"{self.modules[file]}:{name.upper()}"

    def key(self, file: int, name: str) -> str | None:
        """Return the key of the point that a name in a file refers to, None if there is none."""
        keys = (self.scoped(file, name, is_shared=is_shared) for is_shared in (False, True))
        return next((key for key in keys if self.points.knows(key)), None)

    def mentioned(self, file: int, name: str, after: str) -> list[str]:
        """Return the keys of the points that a name and the text after it may refer to: all elements of an array if
        the index is not a number."""
        if key := self.key(file, name):
            return [key]
        scopes = (self.scoped(file, name, is_shared=is_shared) for is_shared in (False, True))
        elements = next((self.arrays[scope] for scope in scopes if scope in self.arrays), [])
        index = _ELEMENT.match(after)
        return [key for key in elements if not index or key.endswith(f"[{int(index[1])}]")]

    def fdat_name(self, file: int, name: str) -> str | None:
        """Return the key of the FDAT that a name in a file refers to, None if there is none."""
        keys = (self.scoped(file, name, is_shared=is_shared) for is_shared in (False, True))
        return next((key for key in keys if key in self.fdat), None)

    def define(self, file: int, name: str, *, everywhere: bool) -> None:
        """Add the name of a routine. Visible to all files are global routines and routines named like their file."""
        module = self.modules[file]
        key = f"{module}:{name}"
        self._defined.setdefault(key, []).append(key)
        if everywhere or module.rpartition("/")[2] == name:
            self._defined.setdefault(name, []).append(key)

    def defined(self, file: int, name: str) -> list[str]:
        """Return the candidate routines for a name: routines of the file or, if there are none, global routines."""
        key = name.upper()
        return self._defined.get(f"{self.modules[file]}:{key}") or self._defined.get(key) or []

    def used_routines(self) -> dict[str, tuple[Statement, ...]]:
        """Return the routines of the user, and the routines of the maker that they call."""
        of_maker = {module for file, module in enumerate(self.modules) if self.is_of_maker(file)}
        used = {name for name in self.routines if name.partition(":")[0] not in of_maker}
        todo = [*used, *(call.name for call in self.beside)]
        while todo:
            calls = {call.name for call in self.routines.get(todo.pop(), ()) if isinstance(call, Call)}
            todo += calls - used
            used |= calls
        return {name: body for name, body in self.routines.items() if name in used}

    def call_of(self, file: int, begin: int, name: str) -> Statement:
        """Return the call of a routine, or `ForgetAll` if the name is not unique or not known."""
        routines = self.defined(file, name)
        why = self.why(file, begin, f"{name} is called" if len(routines) == 1 else f"{name} is unknown here")
        return Call(routines[0], why) if len(routines) == 1 else ForgetAll(why)

    def why(self, file: int, begin: int, fact: str) -> Unknown:
        """Return a reason at a position in a text."""
        return Unknown(file, self.lines[file].at(begin), fact[:80])

    def begin(self, file: int, name: str) -> None:
        self.close()
        self.routine = f"{self.modules[file]}:{name.upper()}"
        self.blocks = Blocks()

    def close(self) -> None:
        if self.blocks is not None:
            if len(self._defined.get(self.routine, [])) > 1:  # The name is ambiguous, so calls of it are uncertain.
                why = Unknown(0, 0, f"{self.routine} is defined twice")
                self.routine = f"{self.routine} {len(self.routines)}"
                self.blocks.body.insert(0, ForgetAll(why))
            self.routines[self.routine] = self.blocks.finish_routine()
        self.blocks = None

    def literal(self, file: int, begin: int, text: str, name: str) -> tuple[Target | None, Reason | None]:
        """Return the target of "X 1, Y 2, …", and the reason if it cannot be corrected; None for any other text."""
        parts: dict[str, Number] = {}
        at = begin
        for part in text.split(",", 32):
            component = _COMPONENT.fullmatch(part)
            if not component:
                return None, None
            parts[component[1].upper()] = Number(at + component.start(2), at + component.end(2), _value(component[2]))
            at += len(part) + 1
        joints = any(axis in parts for axis in _AXES)
        if not joints and not any(axis in parts for axis in _POSE):
            return None, None
        names = _AXES if joints else _POSE
        if any(text[parts[letter].begin - begin] == "'" for letter in names if letter in parts):
            return None, None  # Bit patterns are not coordinates, and could not be written back.
        numbers = tuple(parts[axis] for axis in names if axis in parts)
        form: Form = "joints_deg" if joints else "yaw_pitch_roll"
        stated = tuple(letter for letter in "ST" if letter in parts and 0 <= parts[letter].value < 1 << 16)
        values = tuple(int(parts[letter].value) for letter in stated)
        flags = Flags(values, _AGREEING[stated]) if stated else None
        external = tuple((axis, parts[axis].value) for axis in _EXTERNAL if axis in parts)
        target = Target(name, file, self.lines[file].at(begin), form, numbers, flags=flags, external=external)
        if len(numbers) < 6:
            return target, "incomplete"
        return target, "external_axes" if any(is_moved(coordinate) for _, coordinate in external) else None

    def frame(self, text: str) -> Array | None:
        """Return the frame (4, 4) in mm of {X …} or {FRAME: X …}, or None unless all six numbers are present."""
        inside = text.strip()
        if not (inside.startswith("{") and inside.endswith("}")):
            return None
        parts: dict[str, float] = {}
        for part in LITERAL_TYPE.sub("", inside[1:-1]).split(",", 32):
            component = _COMPONENT.fullmatch(part)
            if not component:
                return None
            parts[component[1].upper()] = _value(component[2])
        values = [parts.get(axis, np.nan) for axis in _POSE]
        return frame_of("yaw_pitch_roll", values) if is_frame("yaw_pitch_roll", values) else None

    def place(self, file: int, begin: int, text: str) -> Value | Ref:
        """Return the value assigned to $TOOL or $BASE; "0" is the null frame."""
        right = text.strip()
        if by_number := _BY_NUMBER.fullmatch(right):
            return Ref(f"{by_number[1].upper()}[{int(by_number[2])}]") if int(by_number[2]) else "0"
        if right.upper() in ("$NULLFRAME", "$WORLD"):
            return "0"
        if right.upper() == "$ROBROOT":
            return as_value(np.eye(4))
        frame = self.frame(right)
        if frame is not None:
            return as_value(frame)
        return self.why(file, begin, f"{right} is computed" if right else "nothing is assigned")


def _value(text: str) -> float:
    """Return a number from decimal, binary ('B010') or hexadecimal ('H1A') text."""
    return float(int(text[2:-1], 2 if text[1] in "Bb" else 16)) if text[0] == "'" else float(text)


def lines_in(text: str) -> Iterator[tuple[int, str]]:
    """Yield the start and the text of each line."""
    at = 0
    for line in text.split("\n"):
        yield at, line
        at += len(line) + 1


def read_statement(reader: KrlReader, file: int, begin: int, line: str) -> None:
    """Parse a line of a .src file."""
    if routine := _ROUTINE.match(line):
        reader.begin(file, routine[1])
        return
    blocks = reader.blocks
    if blocks is None:
        if _MOVE.fullmatch(line) or _BARE.fullmatch(line):
            # The line is outside all routines, so the time of execution is unknown.
            _list(reader, file, begin, "not_understood", line)
        return
    word = (_WORD.match(line.strip()) or [""])[0].upper()
    if word in ("END", "ENDFCT"):
        reader.close()
    elif word == "GOTO":
        blocks.add(Jump((line.split()[1].upper() if len(line.split()) > 1 else "",)))
    elif move := _MOVE.fullmatch(line) or _BARE.fullmatch(line):
        _functions(reader, file, begin, line)
        _move(reader, file, begin, line, move)
    elif interrupt := _BESIDE.match(line):
        _runs_concurrently(reader, file, begin, interrupt)
    elif not _flow(reader, blocks, file, begin, line, word):
        _other(reader, blocks, file, begin, line)


def external_axes_in(text: str) -> set[str]:
    """Return the external axes that a text moves away from zero."""
    axes: set[str] = set()
    for mention in _EXTERNAL_MOVED.finditer(text):
        if mention[3]:
            axes.add(mention[3].upper())
        elif not mention[1]:
            axes.update(_EXTERNAL)
        elif float(mention[2]):
            axes.add(mention[1].upper())
    return axes


def read_submit(reader: KrlReader, file: int) -> None:
    """Add the tools and bases set by a program of the submit interpreter, which runs in parallel."""
    body: list[Statement] = []
    for begin, line in lines_in(reader.texts[file]):
        if (assigned := _ASSIGNED.fullmatch(line)) and _HANDED.search(assigned["left"]):
            left = re.sub(r"\s", "", assigned["left"]).upper()
            body += _assigned(reader, file, begin, left, assigned["right"])
            why = reader.why(file, begin, f"{reader.names[file]} runs in parallel and may set the value at any moment")
            reader.beside.append(Call(f"\0{file}", why))
        for call in _CALL.finditer(line):
            if reader.defined(file, call[1]) or effect_of(call[1], "") != "nothing":
                why = reader.why(
                    file, begin, f"{reader.names[file]} runs in parallel and may set the value at any moment"
                )
                body_of_call = _written_by(reader, file, begin, call[1], line[call.end() :])
                _writes_concurrently(reader, file, begin, why, body_of_call)
    reader.routines[f"\0{file}"] = tuple(body)


def _functions(reader: KrlReader, file: int, begin: int, line: str) -> None:
    """Parse the function calls in a line. Arguments passed by reference may be written, and are possible targets."""
    assert reader.blocks is not None  # noqa: S101 - within a routine
    closes = brackets(line)
    for call in _CALL.finditer(line):
        end = closes.get(call.end() - 1, len(line))
        defined = bool(reader.defined(file, call[1]))
        effect = None if defined else effect_of(call[1], line[call.end() : end], reader.texts)
        if effect == "nothing":
            continue
        if effect is None:
            reader.blocks.evaluated(line[: call.start()], reader.call_of(file, begin, call[1]))
            for handed in _AGGREGATE.finditer(line, call.end(), end):
                if reader.literal(file, begin, LITERAL_TYPE.sub("", handed[1]), "")[0]:
                    _list(reader, file, begin, "handed", handed[0])
        if effect in ("arm", "base"):
            reader.blocks.add(Elsewhere())
        if effect == "base":
            why = reader.why(file, begin, f"{call[1]} may correct the base")
            reader.blocks.add(Set("base", why), Set(CORRECTION, why), ForgetFamily("BASE_DATA", why))
        reader.blocks.add(*_written_by(reader, file, begin, call[1], line[call.end() :]))


def _written_by(reader: KrlReader, file: int, begin: int, name: str, after: str) -> list[Statement]:
    """Return the motion settings that a call may write to, given the arguments in the text `after` the name."""
    statements: list[Statement] = []
    for argument in dict.fromkeys(match[0].upper() for match in _HANDED.finditer(after)):
        why = reader.why(file, begin, f"{name} receives {argument} and may change the value")
        parts = _PARTS_OF.get(argument, ())
        statements += [Set(part, why) for part in parts] or [ForgetFamily(argument, why)]
    return statements


def _flow(reader: KrlReader, blocks: Blocks, file: int, begin: int, line: str, word: str) -> bool:
    """Parse a statement of flow control; False for any other statement."""

    def functions() -> None:
        _functions(reader, file, begin, line)

    match word:
        case "IF":
            functions()
            blocks.branch()
        case "SWITCH":
            functions()
            blocks.cases()
        case "CASE":
            blocks.other()
            blocks.guard()
        case "ELSE" | "DEFAULT":
            blocks.other()
        case "FOR" | "WHILE":
            functions()
            blocks.loop()
            functions()
            blocks.may_leave()
        case "LOOP" | "REPEAT":
            blocks.loop()
        case "UNTIL" | "ENDIF" | "ENDSWITCH" | "ENDLOOP" | "ENDFOR" | "ENDWHILE":
            functions()
            if word == "UNTIL":
                blocks.may_leave()
            blocks.close()
        case "EXIT":
            blocks.leave()
        case "RETURN":
            functions()
            blocks.add(End())
        case _:
            if not (label := _LABEL.fullmatch(line)):
                return False
            blocks.add(JumpTarget(label[1].upper()))
    return True


def _runs_concurrently(reader: KrlReader, file: int, begin: int, interrupt: re.Match[str]) -> None:
    """Add the action of an interrupt or a trigger, which may happen at any moment."""
    assert reader.blocks is not None  # noqa: S101 - within a routine
    action = interrupt[1]
    if _ASSIGNED.match(action):
        inner = KrlReader(reader.names, reader.texts, reader.lines, Points(0))
        inner.blocks = Blocks()
        _other(inner, inner.blocks, file, begin, re.sub(r"\bPRIO\s*=.*", "", action, flags=re.IGNORECASE))
        if inner.blocks.body:
            key = f"\0{file}:{begin}"
            reader.routines[key] = tuple(inner.blocks.body)
            reader.beside.append(Call(key, reader.why(file, begin, "an interrupt may set the value at any moment")))
        return
    _calls_concurrently(reader, file, begin, action)


def _calls_concurrently(reader: KrlReader, file: int, begin: int, text: str) -> None:
    """Add calls that may happen at any moment."""
    for call in _CALL.finditer(text):
        statement = reader.call_of(file, begin, call[1])
        effect = None if reader.defined(file, call[1]) else effect_of(call[1], text[call.end() :], reader.texts)
        why = reader.why(file, begin, f"{call[1]} may run at any moment")
        if isinstance(statement, Call):
            reader.beside.append(Call(statement.name, why))
        elif effect not in ("nothing", "arguments"):
            reader.beside.append(Call(f"\0{call[1]}", why))
        if effect != "nothing":
            _writes_concurrently(
                reader, file, begin, why, _written_by(reader, file, begin, call[1], text[call.end() :])
            )


def _writes_concurrently(reader: KrlReader, file: int, begin: int, why: Unknown, body: list[Statement]) -> None:
    """Add statements that may run at any moment, if there are any."""
    if body:
        key = f"\0{file}:{begin}:{len(reader.beside)}"
        reader.routines[key] = tuple(body)
        reader.beside.append(Call(key, why))


def _other(reader: KrlReader, blocks: Blocks, file: int, begin: int, line: str) -> None:
    """Parse an assignment, a call of BAS or of a routine, or a statement without effect."""
    if (bas := _BAS.fullmatch(line)) and not reader.defined(file, "BAS"):
        blocks.add(*_bas(reader, file, begin, bas[1].upper(), (bas[2] or "").strip()))
        return
    why = reader.why(file, begin, f"{line.strip()} is computed")
    for copy in read_copy(line, reader.copies, reader.constants, reader.modules[file], why):
        reader.spent.update((file, begin + column) for column in copy.sources)
        blocks.add(set_copy(copy, reader.modules[file]))
        return
    if assigned := _ASSIGNED.fullmatch(line):
        _functions(reader, file, begin, assigned["right"])
        if _CYCLICAL.match(line):
            _calls_concurrently(reader, file, begin, assigned["right"])
        blocks.add(*_assigned(reader, file, begin, re.sub(r"\s", "", assigned["left"]).upper(), assigned["right"]))
        return
    if _DECLARATION.fullmatch(line):
        return
    if _SPLINE.match(line):
        suffix = _WITH.search(line)
        reader.spline = _with_all(reader, file, begin, suffix[1]) if suffix else {}
    if NOTHING.fullmatch(line) or _CALL.match(line.strip()):
        _functions(reader, file, begin, line)
        return
    ends = line.strip().upper() == "RESUME"  # It leaves the interrupted routines, wherever they are.
    fact = "RESUME ends the interrupted routines at any statement" if ends else f"{line.strip()} is unknown here"
    blocks.add(ForgetAll(reader.why(file, begin, fact)))


def _by_number(family: str, number: int) -> ComputedValue:
    """Return a tool or base of the lists as BAS and the inline forms select it, with the corrections of bas.src."""

    def make(values: tuple[Value, ...]) -> Value:
        correction, value = values[0], values[1] if number else "0"
        return value if correction == OFF else correction

    return ComputedValue((CORRECTION, *([f"{family}[{number}]"] if number else [])), make)


def _bas(reader: KrlReader, file: int, begin: int, command: str, argument: str) -> list[Statement]:
    if command in ("TOOL", "BASE"):
        part = command.lower()
        if argument.isdigit():
            return [Set(part, _by_number(f"{command}_DATA", int(argument)))]
        return [Set(part, reader.why(file, begin, f"{command} {argument} is computed"))]
    if command in ("PTP_PARAMS", "CP_PARAMS", "FRAMES"):
        taken: list[Statement] = [Set("tool", Ref("fdat tool")), Set("base", Ref("fdat base"))]
        if command == "CP_PARAMS" and reader.constant:
            taken.append(Set("switch", reader.why(file, begin, "motion data may keep the orientation")))
        return [*taken, Set("external_tcp", Ref("fdat ipo"))]
    if command == "INITMOV":
        why = reader.why(file, begin, "BAS(#INITMOV) sets the controller's defaults")
        reset = ("external_tcp", "switch", CORRECTION)
        return [Set("tool", why), Set("base", why), *(Set(part, OFF) for part in reset)]
    if command in _BAS_NOTHING:
        return []
    return [ForgetAll(reader.why(file, begin, f"BAS(#{command}) is unknown here"))]


def _assigned(reader: KrlReader, file: int, begin: int, left: str, right: str) -> list[Statement]:
    """Return the state changes of an assignment. Assigned points and variables are detected elsewhere, by name."""
    name = re.split(r"[.\[]", left)[0]
    match name:
        case "$TOOL" | "$BASE":
            whole = left == name
            value = (
                reader.place(file, begin, right) if whole else reader.why(file, begin, f"only a part of {name} is set")
            )
            return [Set(name[1:].lower(), value)]
        case "$IPO_MODE" | "$ORI_TYPE":
            mode, computed = right.strip().upper(), reader.why(file, begin, "$ORI_TYPE is computed")
            modes: dict[str, Value] = {"#VAR": OFF, "#JOINT": OFF, "#CONSTANT": "on"}
            outside = Set("external_tcp", OFF if mode == "#BASE" else "on")
            return [outside if name == "$IPO_MODE" else Set("switch", modes.get(mode, computed))]
        case "TOOL_DATA" | "BASE_DATA":
            return _data(reader, file, begin, left, right)
        case "FDAT_ACT":
            why = reader.why(file, begin, "FDAT_ACT is set, but not used by BAS")
            taken = _fdat(reader, file, begin, right.strip() if left == name else "a part of FDAT_ACT")
            return [*taken, Set("tool", why), Set("base", why)]
    statements: list[Statement] = []
    if CORRECTIONS.fullmatch(name) and right.strip().upper() not in ("FALSE", "$NULLFRAME"):
        statements = [Set(CORRECTION, reader.why(file, begin, f"{left} corrects the tool or base"))]
    elif name.startswith("$") and not SYSTEM.fullmatch(name):
        statements = [ForgetAll(reader.why(file, begin, f"{left} is unknown here"))]
    return statements


def _data(reader: KrlReader, file: int, begin: int, left: str, right: str) -> list[Statement]:
    number = re.fullmatch(r"(\w+)\[(\d+)\]", left)
    frame = reader.frame(right)
    if number is None:
        family = left[:9]
        whole = re.match(r"\w+\[(\d+)\]\.", left)
        why = reader.why(file, begin, f"{left} is set")
        return [Set(f"{family}[{int(whole[1])}]", why)] if whole else [ForgetFamily(family, why)]
    part = f"{number[1]}[{int(number[2])}]"
    if frame is None:
        by_number = _BY_NUMBER.fullmatch(right.strip())
        value = reader.place(file, begin, right) if by_number else reader.why(file, begin, f"{left} is computed")
        return [Set(part, value)]
    named = NamedFrame(
        number[2], "tool" if left[0] == "T" else "frame", file, reader.lines[file].at(begin), as_value(frame)
    )
    reader.points.state(named)
    return [Set(part, as_value(frame))]


def _fdat(reader: KrlReader, file: int, begin: int, right: str) -> list[Statement]:
    """Return the settings for BAS(#FRAMES) in an FDAT, given by name or as an aggregate."""
    name = reader.fdat_name(file, right) or ""
    text = right[1:-1] if right.startswith("{") and right.endswith("}") else reader.fdat.get(name)
    if text is None or name in reader.fdat_written:
        why = reader.why(file, begin, f"{right} is unknown here")
        return [Set("fdat tool", why), Set("fdat base", why), Set("fdat ipo", why)]
    statements: list[Statement] = []
    for key, part, family in (("TOOL_NO", "fdat tool", "TOOL_DATA"), ("BASE_NO", "fdat base", "BASE_DATA")):
        number = re.search(rf"\b{key}\s+(\d+)", text, re.IGNORECASE)
        value: Value | ComputedValue = reader.why(file, begin, f"{right} has no {key}")
        if number:
            value = _by_number(family, int(number[1]))
        statements.append(Set(part, value))
    outside = re.search(r"\bIPO_FRAME\s+#(?!BASE\b)", text, re.IGNORECASE)
    return [*statements, Set("fdat ipo", "on" if outside else OFF)]


def _move(reader: KrlReader, file: int, begin: int, line: str, move: re.Match[str]) -> None:
    """Parse a motion with its targets, in the active tool and base or those given after WITH."""
    assert reader.blocks is not None  # noqa: S101 - within a routine
    kind, end = move["kind"].upper().lstrip("S"), move.end("rest")
    state: dict[str, Value | Ref | ComputedValue] = {
        "tool": Ref("tool"), "base": Ref("base"), "ipo_mode": Ref("external_tcp"), "ori_type": Ref("switch"),
        **reader.spline,
    }  # fmt: skip
    if suffix := _WITH.search(line, move.start("rest")):
        end = suffix.start()
        state |= _with_all(reader, file, begin, suffix[1])
    if zone := _ENDS.search(line, move.start("rest"), end):
        end = zone.start()
    if _STAYS.fullmatch(line[move.start("rest") : end].strip()):
        return
    places = arguments(line, move.start("rest"), end)
    name = line[places[0][0] : end]
    if move["relative"]:
        _leave(reader, file, begin, "relative", name)
        return
    count = 2 if kind == "CIRC" else 1
    for place, (start, stop) in enumerate(places[:count]):
        text = line[start:stop]
        if len(places) > count:  # An arc of CA degrees does not end at the target, and keeps the posture at the start.
            _list(reader, file, begin, "arc", text)
            reader.blocks.add(ForgetFamily(EXTERNAL, reader.why(file, begin, _ARC_MOVES_AXES)))
            continue
        reason = reader.literal(file, begin, LITERAL_TYPE.sub("", text[1:-1]), "")[1]
        if file >= reader.points.files and reason == "incomplete":  # {Z 100} keeps the other coordinates of the arm.
            reader.blocks.add(Elsewhere(reader.why(file, begin, text)))
            continue
        copied = reader.copies.get(text.upper())
        key = _point(reader, file, begin, start, copied or text, kind)
        if key is None:
            _leave(reader, file, begin, "not_literal" if _WORD.fullmatch(text) else "computed", text)
            continue
        way = "joint" if kind == "PTP" else "line"
        needs = () if reader.points.joints(key) else ("external_tcp here", "switch here")[: 1 if way == "joint" else 2]
        at = reader.lines[file].at(begin)
        reader.blocks.add(Set("external_tcp here", state["ipo_mode"]), Set("switch here", state["ori_type"]))
        stated = reader.points.target(key).flags
        trusts = None if way == "joint" else LINES if stated and len(stated.values) == 2 else "a single flag"
        arc = f"arc at {file}:{begin}" if count > 1 else ""
        through = place == 0
        motion = Move(key, way, file, at, state["tool"], state["base"], needs, trusts, arc=arc, through=through)
        if copied:
            offset = ComputedValue((part_of(reader.modules[file], text.upper()),), lambda values: values[0])
            motion = replace(motion, key=f"{key} copied at {file}:{begin}", base=key, offset=("frame", offset))
        reader.blocks.add(motion)


def _leave(reader: KrlReader, file: int, begin: int, reason: Reason, name: str) -> None:
    """List a move that cannot be corrected. The position of the arm is unknown afterwards."""
    assert reader.blocks is not None  # noqa: S101 - within a routine
    _list(reader, file, begin, reason, name)
    in_other_file = reason == "relative" and file >= reader.points.files
    reader.blocks.add(Elsewhere(reader.why(file, begin, name) if in_other_file else None))


def _list(reader: KrlReader, file: int, begin: int, reason: Reason, name: str) -> None:
    if file < reader.points.files:
        reader.points.leave(UncorrectedTarget(file, reader.lines[file].at(begin), name.strip()[:60], reason))


def _point(reader: KrlReader, file: int, begin: int, start: int, text: str, kind: str) -> str | None:
    """Return the key of the point of a move, None if there is no such point."""
    if text.startswith("{") and text.endswith("}"):
        inside = LITERAL_TYPE.sub(lambda prefix: " " * len(prefix[0]), text[1:-1])
        target, reason = reader.literal(file, begin + start + 1, inside, kind)
        key = f"{{{file}:{begin + start}"
        if target is None:
            return None
        reader.points.declare(key, target, reason)
        return key
    element = _ELEMENT.search(text)
    name = f"{text[: element.start()].strip()}[{int(element[1])}]" if element and element.end() == len(text) else text
    if (shared := reader.key(file, name)) is None:
        return None
    reader.spent.add((file, begin + start))
    target = reader.points.target(shared)
    if target.file >= reader.points.files > file:
        fact = f"{text} is a point of {reader.names[target.file]}, which this program shares: its numbers stay"
        if not any(notice.text == fact for notice in reader.points.notices):
            reader.points.notices.append(Notice(file, reader.lines[file].at(begin), fact))
    return shared


def _with_all(reader: KrlReader, file: int, begin: int, text: str) -> dict[str, Value | Ref | ComputedValue]:
    """Return the settings given after WITH for a motion or a spline: tool, base and mode."""
    state: dict[str, Value | Ref | ComputedValue] = {}
    for part, stated in _WITH_PART.findall(text):
        value = stated.strip()
        if fdat := _WITH_FDAT.fullmatch(value):
            statements = _fdat(reader, file, begin, fdat[1])
            of_fdat = {statement.part: statement.value for statement in statements if isinstance(statement, Set)}
            part_of_fdat = {"TOOL": "fdat tool", "BASE": "fdat base", "IPO_MODE": "fdat ipo"}[part.upper()]
            state[part.lower()] = of_fdat[part_of_fdat]
        elif part.upper() == "IPO_MODE":
            state[part.lower()] = OFF if value.upper() == "#BASE" else "on"
        else:
            state[part.lower()] = reader.place(file, begin, value)
    if _CONSTANT.search(text):
        state["ori_type"] = "on"
    elif re.search(r"\bSORI_TYP\b", text, re.IGNORECASE) and reader.constant:
        state["ori_type"] = reader.why(file, begin, "motion data may keep the orientation")
    return state
