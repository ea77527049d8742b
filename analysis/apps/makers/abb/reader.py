r"""Reader of targets in RAPID: jointtarget in degrees, and robtarget in mm with a quaternion.

Targets are declared as data or written in a move. Source: ABB, Technical reference manual, RAPID Instructions,
Functions and Data types (3HAC050917). Confdata selects the posture, except after ConfL\Off for lines and ConfJ\Off for
joint moves: the arm then keeps the current posture. tool0 is the flange, and wobj0 is the world, which is assumed to be
the robot's base. Other modules in the same directory are read for the routines, tools and work objects they declare.
`statements` contains the effect of each instruction.
"""

from __future__ import annotations

import re
from typing import Literal

import numpy as np

from analysis.apps.makers.abb.copies import copies_in
from analysis.apps.makers.abb.offsets import known_numbers
from analysis.apps.makers.abb.statements import (
    MOST_ELEMENTS,
    RapidReader,
    external_axes_in,
    literal_frames,
    read_module,
)
from analysis.apps.makers.numbers import Decimals
from analysis.apps.makers.points import Points, as_value
from analysis.apps.makers.program_machine import OFF, Call, Program, Set, Unknown, Value
from analysis.apps.makers.program_reader import ProgramReader, Remark
from analysis.apps.makers.target import (
    NamedFrame,
    Notice,
    Parsed,
    ProgramTexts,
    UncorrectedTarget,
    blanked,
    brackets,
    lines_of,
    with_newlines,
)

_DECIMALS = Decimals(place=(4, 7), turn=(8, 12))
"""Decimals for 0.1 µm, and 1e-8 of a quaternion or of a degree: a num has about seven digits."""
_END = re.compile(rb"^[ \t]*ENDMODULE\b", re.MULTILINE | re.IGNORECASE)
_BLANK = re.compile(r"\"[^\"\n]*\"|![^\n]*|%%%[^%]*%%%")
_DATA = re.compile(
    r"(?<![\w\\])(?P<local>LOCAL\s+|TASK\s+)?(?P<storage>CONST|PERS|VAR)\s+(?P<kind>\w+)\s+(?P<name>\w+)\s*"
    r"(?P<array>\{[^{};]*\}\s*)?(?::=(?P<value>[^;]*))?;",
    re.IGNORECASE,
)
_ELEMENT = re.compile(r"\[(?=\s*\[\s*[-+.\d])")
"""Start of a target in the value of an array: [[x, y, z], …] or [[q1, …, q6], …]."""
_PARAMETERS = re.compile(r"\b(?:PROC|FUNC\s+\w+)\s+\w+\s*\(([^()]*)\)", re.IGNORECASE)
_LAST = re.compile(r",\s*([A-Za-z]\w*)\s*(?=[\\;])")
_WOBJ = re.compile(r"\\\s*WObj\s*:=\s*(\w+)", re.IGNORECASE)
"""The work object of a move."""
_WORD = re.compile(r"[A-Za-z]\w*")
_NULL = {"tool tool0": np.eye(4), "frame wobj0": np.eye(4)}


def parse(texts: ProgramTexts) -> Parsed:
    """Parse the targets of a module."""
    blank = tuple(blanked(with_newlines(text), _BLANK) for text in texts.texts)
    reader = RapidReader(texts.names, blank, tuple(map(lines_of, blank)), Points(texts.own))
    stated: dict[str, Value] = {key: as_value(frame) for key, frame in _NULL.items()}
    # They belong to the system module BASE.sys, which may be in the same directory.
    reader.of |= dict.fromkeys(_NULL, len(blank))
    for file in range(len(blank)):
        _declare(reader, file, stated)
    for named in reader.numeric.values():
        reader.points.state(named)
    for text in blank:
        reader.frames |= {f"tool {name.lower()}" for name in _LAST.findall(text)}
        reader.frames |= {f"frame {name.lower()}" for name in _WOBJ.findall(text)}
    reader.numbers.known |= known_numbers(blank)
    reader.copies, places = copies_in(blank, reader.numbers, frozenset(reader.points.keys()))
    reader.spent |= places
    _external_axes(reader)
    _hide_by_parameters(reader)
    for file in range(len(blank)):
        read_module(reader, file)
    _other_tasks(reader)
    for file, text in enumerate(blank):
        for word in _WORD.finditer(text):
            name = word[0].lower()
            keys = reader.arrays.get(name, [name] if reader.points.knows(name) else [])
            if (file, word.start()) in reader.spent:
                continue
            if file < texts.own or (name in reader.shared and name not in reader.declares[file]):
                for key in keys:
                    reader.points.change(key, file, reader.lines[file].at(word.start()))
    if reader.by_name:
        for key in list(reader.points.keys()):
            reader.points.change(key, reader.by_name.file, reader.by_name.line)

    def initial(part: str) -> Value:
        kind, _, name = part.partition(" ")
        if kind in ("tool", "frame"):
            return stated.get(part, name)
        return "on" if kind == "conf" else OFF

    kept, starts = ("tool ", "frame "), _first_routine(reader)
    concurrent = tuple(reader.beside), tuple(reader.broken)
    return reader.points.parsed(Program(reader.routines, initial, *concurrent, kept, cycles=True, starts=starts))


def _hide_by_parameters(reader: RapidReader) -> None:
    """Make tools and work objects unknown if a parameter of a routine has the same name."""
    for file, text in enumerate(reader.texts):
        for parameters in _PARAMETERS.finditer(text):
            for word in _WORD.finditer(text, parameters.start(1), parameters.end(1)):
                why = Unknown(file, reader.lines[file].at(word.start()), f"{word[0]} is a parameter of a routine")
                reader.shadowed |= {f"{kind} {word[0].lower()}": why for kind in ("tool", "frame")}


def _first_routine(reader: RapidReader) -> str | None:
    """Return the routine with which the operator starts the program: main, or the only one that no other calls."""
    bodies, own = reader.routines.items(), range(reader.points.files)
    called = {statement.name for _, body in bodies for statement in body if isinstance(statement, Call)}
    called |= {call.name for call in (*reader.beside, *reader.broken)}
    first = [f"{file}:main" for file in own if f"{file}:main" in reader.routines]
    first = first or [name for name in reader.routines if name not in called and int(name.partition(":")[0]) in own]
    return first[0] if len(first) == 1 else None


def _external_axes(reader: RapidReader) -> None:
    """Add the external axes that the program moves.

    A module beside the program with a main routine of its own belongs to another program, which may be a variant of
    this one.
    """
    own = reader.points.files
    has_main = [re.search(r"\bPROC\s+main\s*\(", text, re.IGNORECASE) is not None for text in reader.texts]
    texts = [
        text for file, text in enumerate(reader.texts) if file < own or not (has_main[file] and any(has_main[:own]))
    ]
    axes = external_axes_in(texts)
    reader.points.axes |= axes.moved
    reader.points.notices += [
        Notice(
            0, 1, f"external axis {axis} is at {position:g} in every target; rig assumes that it does not carry the arm"
        )
        for axis, position in axes.constant.items()
    ]


def _other_tasks(reader: RapidReader) -> None:
    """Add the tools and work objects set by other tasks and programs.

    A module with a main routine belongs to another task or program. Tasks may share persistent data of the same name.
    """
    if not any(f"{file}:main" in reader.routines for file in range(reader.points.files)):
        return
    for file in range(reader.points.files, len(reader.texts)):
        todo, seen = [f"{file}:main"], set[str]()
        while todo:
            name = todo.pop()
            body = () if name in seen else reader.routines.get(name, ())
            seen.add(name)
            todo += [statement.name for statement in body if isinstance(statement, Call)]
            sets = tuple(
                statement
                for statement in body
                if isinstance(statement, Set) and statement.part.startswith(("tool ", "frame "))
            )
            if sets:
                key = f"\0{file} {name}"
                reader.routines[key] = sets
                reader.beside.append(
                    Call(key, Unknown(file, 1, f"the main routine of {reader.names[file]} may run in parallel"))
                )


def _declare(reader: RapidReader, file: int, stated: dict[str, Value]) -> None:
    """Add the points, tools and work objects declared by a module. Modules of the program are read first."""
    text, declares = reader.texts[file], set()
    for declared in _DATA.finditer(text):
        kind, name = declared["kind"].lower(), declared["name"].lower()
        declares.add(name)
        local = bool(declared["local"]) and declared["local"].strip().upper() == "LOCAL"
        of_program = file < reader.points.files
        if kind not in ("robtarget", "jointtarget"):
            if kind in ("tooldata", "wobjdata"):
                _declare_frame(reader, file, kind, declared, stated, shares=not local)
        elif of_program and declared["value"] and declared["array"]:
            _declare_array(reader, file, declared, shares=not local)
        elif of_program and declared["value"]:
            begin = declared.start("value")
            target = reader.literal(file, kind, begin, declared.end("value"), declared["name"])
            if target:
                reader.spent.add((file, declared.start("name")))
                reader.points.declare(name, target)
                if not local:
                    reader.shared.add(name)
        elif of_program and not declared["array"]:
            _declare_assigned(reader, file, declared, shares=not local)
    reader.declares.append(declares)


def _declare_assigned(reader: RapidReader, file: int, declared: re.Match[str], *, shares: bool) -> None:
    """Add a point that is declared without a value and assigned with numbers. A second assignment changes it."""
    name = declared["name"]
    for assigned in re.finditer(rf"(?<![\w.]){name}\s*:=(?P<value>[^;]*)", reader.texts[file], re.IGNORECASE):
        target = reader.literal(file, declared["kind"].lower(), *assigned.span("value"), name)
        if target and (file, assigned.start()) not in reader.spent:
            reader.spent |= {(file, declared.start("name")), (file, assigned.start())}
            reader.points.declare(name.lower(), target)
            reader.shared |= {name.lower()} if shares else set()


def _declare_array(reader: RapidReader, file: int, declared: re.Match[str], *, shares: bool) -> None:
    """Add the elements of an array as points if rig can trace it: one dimension, numbers, and not too many elements."""
    text, kind, name = reader.texts[file], declared["kind"].lower(), declared["name"]
    begin, end = declared.span("value")
    closes = brackets(text[begin:end])
    starts = [found.start() for found in _ELEMENT.finditer(text, begin, end)]
    elements = [
        reader.literal(file, kind, start, begin + closes.get(start - begin, 0) + 1, f"{name}{{{k}}}")
        for k, start in enumerate(starts, start=1)
    ]
    targets = [target for target in elements if target]
    size = re.fullmatch(r"\{\s*(\d+)\s*\}\s*", declared["array"])
    if size and 0 < len(targets) == len(elements) == int(size[1]) <= MOST_ELEMENTS:
        reader.arrays[name.lower()] = [f"{name.lower()}{{{k}}}" for k in range(1, len(targets) + 1)]
        reader.spent.add((file, declared.start("name")))
        for key, target in zip(reader.arrays[name.lower()], targets, strict=True):
            reader.points.declare(key, target)
        reader.shared |= {name.lower()} if shares else set()
        return
    for start in starts:
        reader.points.leave(UncorrectedTarget(file, reader.lines[file].at(start), name, "array"))


def _declare_frame(
    reader: RapidReader, file: int, kind: str, declared: re.Match[str], stated: dict[str, Value], *, shares: bool
) -> None:
    """Add a declared tool or work object.

    If the value is not numeric, the user can state the frame by name. If a name is declared twice, the frame is
    unknown, except for persistent data shared by tasks with the same numbers. Two modules that declare a global name
    with different numbers are variants or belong to different tasks: the user states the frame.
    """
    family: Literal["tool", "frame"] = "tool" if kind == "tooldata" else "frame"
    name, line = declared["name"].lower(), reader.lines[file].at(declared.start("name"))
    part = f"{family} {name}"
    reader.frames.add(part)
    frames = literal_frames(kind, declared["value"] or "")
    value: Value = Unknown(file, line, f"{declared['name']} is not declared with numbers, on the robot")
    if frames is not None:
        value = as_value(frames)
    elif declared["value"] is None:
        value = name
    shared_by = file if shares and declared["storage"].upper() == "PERS" else -1
    if part not in stated:
        stated[part], reader.of[part] = value, shared_by
        reader.globals |= {part: file} if shares else {}
        if frames is not None:
            reader.numeric[part] = NamedFrame(declared["name"], family, file, line, as_value(frames))
    elif shares and reader.globals.get(part, file) != file:
        if value != stated[part]:
            stated[part] = name
            reader.numeric.pop(part, None)
            fact = f"{declared['name']} has other numbers in {reader.names[reader.globals[part]]}"
            reader.points.notices.append(Notice(file, line, f"{fact}; state --{family} {declared['name']}"))
    elif value != stated[part] or -1 in (shared_by, reader.of.get(part, -1)) or file == reader.of[part]:
        reader.shadowed[part] = Unknown(file, line, f"{declared['name']} is declared twice")


READER = ProgramReader(
    parse,
    _DECIMALS,
    Remark("  ! ", before=dict.fromkeys((".mod", ".modx", ".prg"), _END)),
    beside=(".mod", ".modx", ".prg", ".sys", ".sysx"),
    backup=r"TASK\d+|T_ROB\d+",
    empty="MODULE {0}_stated\nPROC {0}()\nENDPROC\nENDMODULE\n",
)
