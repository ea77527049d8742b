"""Statements of RAPID as statements of the state machine. `instructions` contains the effect of each instruction.

PDispOn and PDispSet displace poses, not joint angles. Handlers (ERROR, UNDO) and traps may run at any moment, and may
end a routine with a handler at any statement.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace

from analysis.apps.makers.abb.copies import OFFSET, Reached, read_target
from analysis.apps.makers.abb.instructions import EFFECT, FUNCTIONS, MOVE, SWITCHES, TOOL_THIRD, WRITES
from analysis.apps.makers.abb.offsets import Numbers
from analysis.apps.makers.abb.posture import agreeing, quadrants
from analysis.apps.makers.numbers import frame_of, is_frame
from analysis.apps.makers.points import Points, as_value
from analysis.apps.makers.program_machine import (
    EXTERNAL,
    OFF,
    Blocks,
    Call,
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
    Flags,
    LineNumbers,
    NamedFrame,
    Number,
    Target,
    UncorrectedTarget,
    arguments,
    brackets,
)
from analysis.correction.reasons import Reason
from analysis.robot.kinematics.arm import Array

_NUMBER = re.compile(NUMBER)
_WORD = re.compile(r"[A-Za-z]\w*")
_CALL = re.compile(r"(?<![\w\\])([A-Za-z]\w*)\s*\(")
_WOBJ = re.compile(r"\\\s*WObj\s*(?P<given>:=|\?)\s*(?P<name>[^\\,;]+)", re.IGNORECASE)
_TRACKED = re.compile(r"\\\s*(?:Corr|Track)\b", re.IGNORECASE)
_ASSIGNED = re.compile(
    r"\s*(?P<name>[A-Za-z]\w*)(?P<part>\s*(?:\{[^{};]*\}|\.\w+)(?:\s*\{[^{};]*\}|\.\w+)*)?\s*:=(?P<right>.*)", re.DOTALL
)
_INSTRUCTION = re.compile(r"\s*(?P<name>[A-Za-z]\w*)(?P<rest>.*)", re.DOTALL)
_DATA = re.compile(r"\s*(?:(?:LOCAL|TASK)\s+)?(?:CONST|PERS|VAR)\b", re.IGNORECASE)
_HANDED = re.compile(r"\[\s*\[[^\[\]]*\](?:\s*,\s*\[[^\[\]]*\])+\s*\]")
"""A literal target among the arguments of a routine."""
_SHAPE = {"robtarget": (3, 4, 4, 6), "jointtarget": (6, 6)}
_EXTERNAL = tuple("abcdef")
"""The external axes of a target, in order."""
_ANY_AXIS = "any"
"""Placeholder for the axes moved by an instruction that does not name the axes."""
_EXTERNAL_MOVED = re.compile(r"\b(?:MoveExtJ|SearchExtJ|Ind[ARCD]Move)\b|\.\s*(?:extax|eax_[a-f])\b", re.IGNORECASE)
"""Pattern of a text that moves any external axes."""
_OFFSET_EXTERNAL = re.compile(r"\bEOffs(?:On|Set)\b", re.IGNORECASE)
"""Pattern of a text that offsets external axes: only targets that name an axis are affected."""
_COORDINATES = re.compile(rf"\[((?:\s*{NUMBER}\s*,){{5}}\s*{NUMBER}\s*)\]\s*\]")
"""The coordinates of external axes at the end of a target."""
_NO_AXIS = 8.9e9
"""The value 9E9 for an axis not present."""
MOST_ELEMENTS = 20
"""Maximum size of an array of points that is traced: a move to a variable element leads from and to any other one."""
_INDEXED = re.compile(r"(\w+)\s*\{([^{},]*)\}")
_HEAD = re.compile(
    r"\s*(?:(?P<routine>(?:LOCAL\s+)?(?:PROC|FUNC\s+\w+|TRAP))\s+(?P<name>\w+)"
    r"|(?P<word>IF|ELSEIF|ELSE|ENDIF|WHILE|ENDWHILE|FOR|ENDFOR|TEST|CASE|DEFAULT|ENDTEST|ENDPROC|ENDFUNC|ENDTRAP|"
    r"MODULE|ENDMODULE|ERROR|UNDO|BACKWARD|RECORD)\b(?!\s*:=)|(?P<label>[A-Za-z]\w*)\s*:(?!=))",
    re.IGNORECASE,
)
_UNTIL = {
    "IF": re.compile(r"\bTHEN\b|;", re.IGNORECASE),
    "ELSEIF": re.compile(r"\bTHEN\b|;", re.IGNORECASE),
    "WHILE": re.compile(r"\bDO\b|;", re.IGNORECASE),
    "FOR": re.compile(r"\bDO\b|;", re.IGNORECASE),
    "TEST": re.compile(r"\bCASE\b|\bDEFAULT\b|\bENDTEST\b|;", re.IGNORECASE),
    "CASE": re.compile(r":(?!=)|;"),
    "DEFAULT": re.compile(r":|;"),
    "MODULE": re.compile(r"\n|\)"),
    "RECORD": re.compile(r"\bENDRECORD\b", re.IGNORECASE),
}
"""The end of a header without a semicolon."""
_OPERATORS = ("AND", "OR", "XOR", "NOT", "DIV", "MOD")


def literal_frames(kind: str, text: str) -> Array | None:
    """Return the frame (4, 4) in mm of a literal of tooldata or wobjdata.

    None if the literal is not a tool held by the robot, or a work object not held by the robot.
    """
    shape = {
        "tooldata": "[TRUE,[[000],[0000]],[0,[000],[0000],000]]",
        "wobjdata": '[FALSE,TRUE,"",[[000],[0000]],[[000],[0000]]]',
    }[kind]
    if re.sub(r"\s", "", _NUMBER.sub("0", text)).replace("0,0", "00").replace("0,0", "00").upper() != shape:
        return None
    values = [float(number[0]) for number in _NUMBER.finditer(text)]
    sets = [values[k : k + 7] for k in range(0, 7 * shape.count("[[000],[0000]]"), 7)]
    if not all(is_frame("quaternion", components) for components in sets):
        return None
    frames = [frame_of("quaternion", components) for components in sets]
    return frames[0] if kind == "tooldata" else frames[0] @ frames[1]


@dataclass
class RapidReader:
    """State of a program during parsing, with names in lower case."""

    names: tuple[str, ...]
    texts: tuple[str, ...]
    lines: tuple[LineNumbers, ...]
    points: Points
    spent: set[tuple[int, int]] = field(default_factory=set)
    shared: set[str] = field(default_factory=set)
    declares: list[set[str]] = field(default_factory=list)
    frames: set[str] = field(default_factory=set)
    of: dict[str, int] = field(default_factory=dict)
    globals: dict[str, int] = field(default_factory=dict)
    """The modules that first declare tools and work objects for all modules."""
    numeric: dict[str, NamedFrame] = field(default_factory=dict)
    """The tools and work objects whose numbers are those of their declaration."""
    routines: dict[str, tuple[Statement, ...]] = field(default_factory=dict)
    beside: list[Call] = field(default_factory=list)
    broken: list[Call] = field(default_factory=list)
    shadowed: dict[str, Unknown] = field(default_factory=dict)
    """Tools and work objects whose name has a different meaning in a routine."""
    arrays: dict[str, list[str]] = field(default_factory=dict)
    """The keys of the elements of arrays of points."""
    copies: dict[str, Reached] = field(default_factory=dict)
    numbers: Numbers = field(default_factory=Numbers)
    by_name: Unknown | None = None
    """The place at which the program writes data selected by a name in a string."""
    file: int = 0
    blocks: Blocks | None = None
    routine: str = ""
    _defined: dict[str, list[str]] | None = None

    def why(self, begin: int, fact: str) -> Unknown:
        """Return a reason at a position in the current module."""
        return Unknown(self.file, self.lines[self.file].at(begin), " ".join(fact.split())[:80])

    def defined(self, name: str) -> list[str]:
        """Return the candidate routines for a name: routines of the current module or, if there are none, global
        ones.
        """
        if self._defined is None:
            self._defined = {}
            for file, text in enumerate(self.texts):
                for routine in re.finditer(r"\b(LOCAL\s+)?(?:PROC|FUNC\s+\w+)\s+(\w+)\s*\(", text, re.IGNORECASE):
                    key = routine[2].lower()
                    self._defined.setdefault(f"{file}:{key}", []).append(f"{file}:{key}")
                    if not routine[1]:
                        self._defined.setdefault(key, []).append(f"{file}:{key}")
        key = name.lower()
        return self._defined.get(f"{self.file}:{key}") or self._defined.get(key) or []

    def call_of(self, begin: int, name: str) -> Statement:
        """Return the call of a routine, or `ForgetAll` if the name is not unique or not known."""
        routines = self.defined(name)
        why = self.why(begin, f"{name} is called" if len(routines) == 1 else f"{name} is unknown here")
        return Call(routines[0], why) if len(routines) == 1 else ForgetAll(why)

    def literal(self, file: int, kind: str, begin: int, end: int, name: str) -> Target | None:
        """Return the target written as [[…],[…]…]; None for other text."""
        text = self.texts[file]
        groups = list(re.compile(r"\[([^\[\]]*)\]").finditer(text, begin, end))
        outside = re.sub(r"\s", "", re.sub(r"\[[^\[\]]*\]", "g", text[begin:end]))
        if outside != "[" + ",".join("g" * len(_SHAPE[kind])) + "]":
            return None
        numbers: list[Number] = []
        for group, count in zip(groups, _SHAPE[kind], strict=True):
            places = arguments(text, group.start(1), group.end(1))
            matches = [(_NUMBER.fullmatch(text, *place), place) for place in places]
            if len(matches) != count or not all(match for match, _ in matches):
                return None
            numbers += [Number(*place, float(match[0])) for match, place in matches if match]
        line = self.lines[file].at(begin + len(text[begin:end]) - len(text[begin:end].lstrip()))
        named = zip(_EXTERNAL, (number.value for number in numbers[-6:]), strict=True)
        external = tuple((axis, coordinate) for axis, coordinate in named if coordinate < _NO_AXIS)
        if kind == "jointtarget":
            return Target(name, file, line, "joints_deg", tuple(numbers[:6]), external=external)
        values = tuple(int(max(-99, min(99, number.value))) for number in numbers[7:11])
        flags = Flags(values, agreeing, quadrants, tuple(numbers[7:11]))
        return Target(name, file, line, "quaternion", tuple(numbers[:7]), flags=flags, external=external)


@dataclass(frozen=True)
class ExternalAxes:
    """The external axes that the texts of a program move, and the positions of those that are always elsewhere than
    zero, but never move."""

    moved: frozenset[str]
    constant: Mapping[str, float]


def external_axes_in(texts: Iterable[str]) -> ExternalAxes:
    """Return the external axes of texts. An axis that every target names with the same value does not move."""
    moved, constant = set[str](), dict[str, float]()
    together = "\n".join(texts)
    rows = [tuple(map(float, found[1].split(","))) for found in _COORDINATES.finditer(together)]
    for axis, column in zip(_EXTERNAL, zip(*rows, strict=True), strict=bool(rows)):
        values = {min(value, _NO_AXIS) for value in column}
        if len(values) > 1 and values - {0.0, _NO_AXIS}:
            moved.add(axis)
        elif not values & {0.0, _NO_AXIS}:
            constant[axis] = column[0]
    names_any = any(value < _NO_AXIS for row in rows for value in row)
    if _EXTERNAL_MOVED.search(together) or (names_any and _OFFSET_EXTERNAL.search(together)):
        moved.add(_ANY_AXIS)
    return ExternalAxes(frozenset(moved), constant)


def read_module(reader: RapidReader, file: int) -> None:
    """Parse the routines of a module."""
    reader.file = file
    for begin, end, head in _statements(reader.texts[file]):
        if head is not None and head["routine"]:
            _close(reader)
            reader.routine = f"{reader.file}:{head['name'].lower()}"
            if head["routine"].upper().endswith("TRAP"):
                reader.beside.append(
                    Call(reader.routine, reader.why(head.start("name"), f"the trap {head['name']} may run"))
                )
            elif reader.routine in reader.routines:  # The name is ambiguous, so calls of it are uncertain.
                reader.routine = f"{reader.routine} {len(reader.routines)}"
            reader.blocks = Blocks()
            reader.numbers.loops.clear()
        elif reader.blocks is None:
            continue
        elif head is not None and head["label"]:
            reader.blocks.add(JumpTarget(head["label"].lower()))
        elif head is not None:
            _flow(reader, reader.blocks, head["word"].upper(), head.end(), end)
        else:
            _statement(reader, begin, end)
    _close(reader)


def _statements(text: str) -> Iterator[tuple[int, int, re.Match[str] | None]]:
    """Yield the ranges of statements and headers; headers also with their match."""
    at = 0
    while at < len(text):
        head = _HEAD.match(text, at)
        if head is None:
            end = text.find(";", at)
            end = len(text) if end < 0 else end
            if text[at:end].strip():
                yield at, end, None
            at = end + 1
            continue
        end = head.end()
        if head["routine"]:
            opening = re.compile(r"\s*\(").match(text, end)
            close = text.find(")", end) if opening else -1
            end = close + 1 if close >= 0 else end
        elif head["word"] and (until := _UNTIL.get(head["word"].upper())):
            ended = until.search(text, end)
            stop = len(text) if ended is None else ended.start() if head["word"].upper() == "TEST" else ended.end()
            end = max(end, stop)
        yield at, end, head
        at = end


def _close(reader: RapidReader) -> None:
    if reader.blocks is not None:
        reader.routines[reader.routine] = reader.blocks.finish_routine()
    reader.blocks = None


def _flow(reader: RapidReader, blocks: Blocks, word: str, begin: int, end: int) -> None:
    """Parse a block header with its condition in [begin, end), or a keyword that ends a block."""
    text = reader.texts[reader.file]
    match word:
        case "IF":
            compact = text[end - 1 : end] == ";"
            start = _after_condition(text, begin, end) if compact else end
            _functions(reader, begin, start)
            blocks.branch()
            if compact:
                _statement(reader, start, end - 1)
                blocks.close()
        case "TEST":
            _functions(reader, begin, end)
            blocks.cases()
        case "ELSEIF" | "CASE":
            blocks.other()
            _functions(reader, begin, end)
            blocks.guard()
        case "ELSE" | "DEFAULT":
            blocks.other()
        case "WHILE" | "FOR":
            if word == "FOR":
                reader.numbers.enter(text[begin:end])
            _functions(reader, begin, end)
            blocks.loop()
            _functions(reader, begin, end)
            blocks.may_leave()
        case "ENDIF" | "ENDTEST" | "ENDWHILE" | "ENDFOR":
            if word == "ENDFOR":
                reader.numbers.leave()
            blocks.close()
        case "ENDPROC" | "ENDFUNC" | "ENDTRAP" | "ENDMODULE":
            _close(reader)
        case "ERROR" | "UNDO" | "BACKWARD":
            _handler(reader, begin, word)
        case _:
            pass


def _handler(reader: RapidReader, begin: int, word: str) -> None:
    """End the routine before its handler.

    The handler may run at any moment, and the routine may then continue at any statement.
    """
    routine = reader.routine.removesuffix(" handler")
    _close(reader)
    reader.routine = f"{routine} handler"
    if reader.routine in reader.routines:
        reader.routine += f" {len(reader.routines)}"
    why = reader.why(begin, f"the handler {word} may run")
    reader.beside.append(Call(reader.routine, why))
    reader.broken.append(Call(routine, why))
    reader.blocks = Blocks()


def _after_condition(text: str, begin: int, end: int) -> int:
    """Return the start of the statement in `IF condition statement;`: the first word directly after a value."""
    value, depth = False, 0
    for token in re.compile(r"[A-Za-z]\w*|[\d.]+|\"|[()\[\]{}]|[^\s]").finditer(text, begin, end):
        part = token[0]
        if part in "([{":
            depth, value = depth + 1, False
        elif part in ")]}":
            depth, value = depth - 1, True
        elif part[0].isalpha():
            if value and depth == 0 and part.upper() not in _OPERATORS:
                return token.start()
            value = part.upper() not in _OPERATORS
        else:
            value = part[0].isdigit() or part == '"'
    return end


def _functions(reader: RapidReader, begin: int, end: int) -> None:
    """Parse the function calls in an expression."""
    assert reader.blocks is not None  # noqa: S101 - within a routine
    text = reader.texts[reader.file]
    closes = brackets(text[begin:end])
    for call in _CALL.finditer(text, begin, end):
        closing = begin + closes.get(call.end() - 1 - begin, end - begin)
        if reader.defined(call[1]) or call[1].lower() not in FUNCTIONS:
            reader.blocks.evaluated(text[begin : call.start()], reader.call_of(call.start(), call[1]))
            _handed(reader, call.end(), closing, call[1])
        elif call[1].lower() in WRITES:
            _handed(reader, call.end(), closing, call[1])


def _handed(reader: RapidReader, begin: int, end: int, name: str) -> None:
    """Parse the arguments of a routine or instruction, which may write to tools and work objects or move to targets."""
    assert reader.blocks is not None  # noqa: S101 - within a routine
    text = reader.texts[reader.file]
    for handed in _HANDED.finditer(text, begin, end):
        if any(reader.literal(reader.file, kind, handed.start(), handed.end(), "") for kind in _SHAPE):
            _list(reader, handed.start(), "handed", handed[0])
    for word in _WORD.finditer(text, begin, end):
        for kind in ("tool", "frame"):
            if f"{kind} {word[0].lower()}" in reader.frames:
                why = reader.why(begin, f"{word[0]} is passed to {name}")
                reader.blocks.add(Set(f"{kind} {word[0].lower()}", why))


def _statement(reader: RapidReader, begin: int, end: int) -> None:
    """Parse an instruction, an assignment or a call."""
    assert reader.blocks is not None  # noqa: S101 - within a routine
    text, blocks = reader.texts[reader.file], reader.blocks
    begin += len(text[begin:end]) - len(text[begin:end].lstrip())
    if _DATA.match(text, begin, end) or not text[begin:end].strip():
        _functions(reader, begin, end)
        return
    if assigned := _ASSIGNED.fullmatch(text, begin, end):
        _functions(reader, assigned.start("right"), end)
        _assigned(reader, begin, assigned)
        return
    instruction = _INSTRUCTION.fullmatch(text, begin, end)
    if instruction is None:
        blocks.add(ForgetAll(reader.why(begin, f"{text[begin:end]} is unknown here")))
        return
    name, at = instruction["name"].lower(), instruction.start("name")
    _functions(reader, instruction.start("rest"), end)
    if reader.defined(instruction["name"]):
        blocks.add(reader.call_of(at, instruction["name"]))
        _handed(reader, instruction.start("rest"), end, instruction["name"])
    elif move := MOVE.fullmatch(instruction["name"]):
        _move(reader, at, instruction, move)
    elif switch := _switch(name, instruction["rest"]):
        blocks.add(switch)
    elif name == "goto":
        blocks.add(Jump((instruction["rest"].strip().lower(),)))
    elif name in ("return", "exit", "exitcycle"):
        blocks.add(End(halts=name != "return"))
    else:
        _handed(reader, instruction.start("rest"), end, instruction["name"])  # Incr, UnpackRawBytes, WaitWObj write.
        _apply(reader, at, instruction["name"])


def _apply(reader: RapidReader, at: int, name: str) -> None:
    """Apply the effect of an instruction that is neither a move nor a switch."""
    assert reader.blocks is not None  # noqa: S101 - within a routine
    match EFFECT.get(name.lower(), "nothing" if name.lower() in FUNCTIONS else None):
        case "nothing":
            return
        case "arm":
            reader.blocks.add(Elsewhere())
        case "external" | "offset of external axes":
            reader.blocks.add(ForgetFamily(EXTERNAL, reader.why(at, f"{name} moves external axes")))
        case "program":
            reader.blocks.add(ForgetAll(reader.why(at, f"{name} may load or select another program")))
        case "data by name":
            reader.by_name = reader.why(at, "data are written by a name in a string")
            reader.blocks.add(ForgetAll(reader.by_name))
        case None:
            reader.blocks.add(ForgetAll(reader.why(at, f"{name} is unknown here")))


def _switch(name: str, rest: str) -> Set | None:
    """Return the state change of an instruction that switches a mode, or None for any other instruction."""
    if name in ("confl", "confj"):
        off = re.search(r"\\\s*Off\b", rest, re.IGNORECASE)
        return Set(f"conf {name[-1]}", "off" if off else "on")
    if name == "singarea":
        lock = re.search(r"\\\s*LockAxis4\b", rest, re.IGNORECASE)
        return Set("switch", "on" if lock else OFF)
    if name == "cirpathmode":
        wrist = re.search(r"\\\s*Wrist\d\d\b", rest, re.IGNORECASE)
        return Set("switch arcs", "on" if wrist else OFF)
    return Set(*SWITCHES[name]) if name in SWITCHES else None


def _assigned(reader: RapidReader, begin: int, assignment: re.Match[str]) -> None:
    """Parse an assignment to a tool or a work object. Assigned points are detected elsewhere, by name."""
    assert reader.blocks is not None  # noqa: S101 - within a routine
    name, right = assignment["name"].lower(), assignment["right"].strip()
    for kind, data in (("tool", "tooldata"), ("frame", "wobjdata")):
        part = f"{kind} {name}"
        if part not in reader.frames:
            continue
        value: Value | Ref = reader.why(begin, f"{assignment['name']} is assigned there")
        if not assignment["part"]:
            frames = literal_frames(data, right)
            if frames is not None:
                value = as_value(frames)
            elif f"{kind} {right.lower()}" in reader.frames or right.lower() in ("tool0", "wobj0"):
                value = Ref(f"{kind} {right.lower()}")
        reader.blocks.add(Set(part, value))


def _move(reader: RapidReader, at: int, instruction: re.Match[str], move: re.Match[str]) -> None:
    assert reader.blocks is not None  # noqa: S101 - within a routine
    text = reader.texts[reader.file]
    kind = next(found for found in move.groups() if found).upper()
    places = arguments(text, instruction.start("rest"), instruction.end("rest"))
    places = [place for place in places if not text.startswith("\\", place[0])]  # \Conc, and \WObj after a comma
    may_stop = move["search"] or move["contact"]
    if move["search"]:  # The signal and the found point come first.
        places = places[2:]
    count = 2 if kind == "C" else 1
    if len(places) < count + (2 if may_stop else 3):
        _leave(reader, at, "computed", instruction[0])
        return
    of_tool = places[count + 2 if TOOL_THIRD.fullmatch(instruction["name"]) else -1]
    wobj = _WOBJ.search(text, instruction.start("rest"), instruction.end("rest"))
    names = {
        "tool": text[slice(*of_tool)].partition("\\")[0].strip(),
        "frame": wobj["name"].strip() if wobj else "wobj0",
    }
    active: dict[str, Unknown | Ref] = {}
    for family, name in names.items():
        part = f"{family} {name.lower()}"
        active[family] = reader.shadowed.get(part) or Ref(part)
        if not _WORD.fullmatch(name):  # Parts of records and elements of arrays are not tracked.
            active[family] = reader.why(at, f"{name} is a part of other data")
    if wobj and wobj["given"] == "?":
        active["frame"] = reader.why(at, f"{names['frame']} may be passed to a routine")
    way = "closest" if kind in ("J", "ABSJ") else "line"
    tracked = move["egm"] or _TRACKED.search(text, instruction.start("rest"), instruction.end("rest"))
    reader.blocks.add(Set("tracking here", "on" if tracked else Ref("tracking")))
    for place, (begin, end) in enumerate(places[:count]):
        line = reader.lines[reader.file].at(begin)
        trusts = "conf l" if way == "line" else "conf j"
        needs = ("shift", "tracking here", "switch", *(["switch arcs"] if kind == "C" else []))
        arc = f"arc at {reader.file}:{at}" if kind == "C" else ""
        state = Move(
            "", way, reader.file, line, active["tool"], active["frame"], needs, trusts, arc=arc, through=place == 0
        )
        _target(reader, begin, end, state, "jointtarget" if kind == "ABSJ" else "robtarget", instruction["name"])
    if may_stop:
        reader.blocks.add(Elsewhere())
    if instruction["name"].lower().endswith("sync"):
        reader.blocks.add(ForgetAll(reader.why(at, f"{instruction['name']} runs a procedure named in a string")))


def _target(reader: RapidReader, begin: int, end: int, move: Move, kind: str, instruction: str) -> None:
    """Parse the target of a move: a point, a literal, or a point with an offset."""
    assert reader.blocks is not None  # noqa: S101 - within a routine
    text, of_program = reader.texts[reader.file], reader.file < reader.points.files
    name = text[begin:end].partition("\\")[0].strip() if not OFFSET.match(text, begin, end) else text[begin:end]
    reached = read_target(text, begin, end, reader.numbers, reader.copies)
    key, offsets = reached.point, list[tuple[str, Value]]()
    if reached.offsets is None:
        offsets = [("frame", reader.why(begin, "the offset is not known from the texts"))]
    else:
        offsets = [(of, as_value(T)) for of, T in reached.offsets]
    begin, end = reached.begin, reached.end
    if text.startswith("[", begin) and of_program:
        target = reader.literal(reader.file, kind, begin, end if offsets else begin + len(name), instruction)
        key = f"[{reader.file}:{begin}"
        if target:
            reader.points.declare(key, target)
    name_of_point, keys = _elements(reader, key)
    visible = of_program or (name_of_point in reader.shared and name_of_point not in reader.declares[reader.file])
    if not visible or not all(map(reader.points.knows, keys)):
        _leave(reader, begin, "not_literal" if _WORD.fullmatch(name) else "computed", name)
        return
    if not key.startswith("["):
        reader.spent.add((reader.file, begin))
    if reader.points.joints(keys[0]):
        move = replace(move, needs=())
    moves: list[Statement] = []
    for of in keys:
        place = f"{of}@{reader.file}:{begin}"
        moves += [replace(move, key=f"{place}#{k}", base=of, offset=offset) for k, offset in enumerate(offsets)]
        moves += [] if offsets else [replace(move, key=of)]
    reader.blocks.add_one_of(moves)


def _elements(reader: RapidReader, key: str) -> tuple[str, list[str]]:
    """Return the name of the point or array of a target, and the keys of the points it may be.

    An element with an unknown index may be any element.
    """
    indexed = _INDEXED.fullmatch(key)
    elements = reader.arrays.get(indexed[1]) if indexed else None
    if indexed is None or elements is None:
        return key, [key]
    values = [value for (value,) in reader.numbers.every_value([indexed[2]], corners=False)]
    places = [int(value) - 1 for value in values if value.is_integer() and 0 < value <= len(elements)]
    known = len(places) == len(values) > 0
    return indexed[1], [elements[place] for place in places] if known else elements


def _leave(reader: RapidReader, begin: int, reason: Reason, name: str) -> None:
    assert reader.blocks is not None  # noqa: S101 - within a routine
    _list(reader, begin, reason, name)
    is_relative = reader.file >= reader.points.files and re.search(r"\bCRobT\b", name, re.IGNORECASE)
    reader.blocks.add(Elsewhere(reader.why(begin, name) if is_relative else None))


def _list(reader: RapidReader, begin: int, reason: Reason, name: str) -> None:
    if reader.file < reader.points.files:
        line = reader.lines[reader.file].at(begin)
        reader.points.leave(UncorrectedTarget(reader.file, line, " ".join(name.split())[:60], reason))
