"""Reader of targets in KRL: E6AXIS and AXIS in degrees; E6POS, POS and FRAME in mm and degrees.

Targets are in a .src file or in the .dat file of the same name. Source: KUKA System Software 8.x, Operating and
Programming Instructions for System Integrators, and public programs with the inline forms of the pendant (FDAT_ACT =
F…, PTP X…, SLIN … WITH $TOOL = STOOL2(F…)). The numbers of tools and bases are in $config.dat: the user states them, or
copies that file into the directory of the program. $NULLFRAME and base 0 are $WORLD. This is assumed to be the robot's
foot if the arm of the rig file is upright, as KUKA delivers it ($ROBROOT zero). `statements` contains the effect of
each statement.
"""

from __future__ import annotations

import re
from dataclasses import replace

from analysis.apps.makers.kuka.closed_lists import is_file_of_maker, is_of_maker
from analysis.apps.makers.kuka.copies import constants_in, copies_in
from analysis.apps.makers.kuka.statements import (
    CORRECTION,
    LINES,
    LITERAL_TYPE,
    KrlReader,
    external_axes_in,
    lines_in,
    read_statement,
    read_submit,
)
from analysis.apps.makers.numbers import Decimals
from analysis.apps.makers.points import Points, as_value
from analysis.apps.makers.program_machine import OFF, Call, Program, Unknown, Value
from analysis.apps.makers.program_reader import ProgramReader, Remark
from analysis.apps.makers.target import NamedFrame, Parsed, ProgramTexts, blanked, lines_of, with_newlines

_DECIMALS = Decimals(place=(4, 7), turn=(6, 9))
"""Decimals of corrected numbers: 0.1 µm and 1e-6°, which is 0.02 µm at 1 m. A REAL of KRL has about seven digits."""
_BLANK = re.compile(r"\"[^\"\n]*\"|;[^\n]*|^[ \t]*&[^\n]*", re.MULTILINE)
_DECLARED = re.compile(
    r"\s*(?:(?:DECL|GLOBAL|CONST)\s+)*(?:(?P<type>E6POS|POS|FRAME|E6AXIS|AXIS)\s+)?"
    r"(?P<name>(?!(?:TOOL|BASE)_DATA\b)[A-Z_]\w*)(?:\s*\[\s*(?P<index>\d+)\s*\])?\s*=\s*\{(?P<list>[^{}]*)\}\s*",
    re.IGNORECASE,
)
_DATA = re.compile(r"\s*(TOOL_DATA|BASE_DATA)\s*\[\s*(\d+)\s*\]\s*=\s*(\{[^{}]*\})\s*", re.IGNORECASE)
_FDAT = re.compile(r"\s*(?:(?:DECL|GLOBAL)\s+)*FDAT\s+(\w+)\s*=\s*\{([^{}]*)\}?", re.IGNORECASE)
_ROUTINE = re.compile(r"\s*(GLOBAL\s+)?(?:DEF|DEFFCT\s+\w+(?:\s*\[[^\]]*\])?)\s+(\w+)\s*\(", re.IGNORECASE)
_TYPED = re.compile(r"\s*(?:(?:DECL|GLOBAL)\s+)*(?:E6POS|POS|FRAME|E6AXIS|AXIS)\s+([\w\s,\[\]]+)", re.IGNORECASE)
_TAKEN = re.compile(r"(?:FDAT_ACT\s*=|\bFDAT|\b(S(?:TOOL2?|BASE|IPO_MODE|LOAD))\s*\()\s*$", re.IGNORECASE)
"""Pattern of the text before a set of tool and base that is read but not written."""
_GLOBAL = re.compile(r"\bGLOBAL\b", re.IGNORECASE)
_WORD = re.compile(r"[A-Za-z_]\w*")
_IMPORT = re.compile(r"\bIMPORT\b[^\n]*\.\.\s*(\w+)", re.IGNORECASE)
"""Pattern of an import, which gives a point of this program another name that other programs can write to."""
_HOME = re.compile(r"\$H_POS\s*=\s*$", re.IGNORECASE)
"""Pattern of the text before a point that becomes the home position, which follows the correction of the point."""
_OUTSIDE = re.compile(r"\$IPO_MODE\s*=(?!\s*#BASE\b)|\bIPO_FRAME\s+#(?!BASE\b)", re.IGNORECASE)
"""Pattern of a text that may select a tool fixed outside of the robot."""
_WRITTEN = re.compile(r"(?:\s*\[[^\]\n]*\])?(?:\.\w+)*[ \t]*=(?!=)")
_OWN_LIST = re.compile(r"\s*(?:(?:DECL|GLOBAL|CONST)\s+)*FRAME\s+(?:.*,\s*)?(TOOL_DATA|BASE_DATA)\b", re.IGNORECASE)
"""Pattern of a list of tools or bases that hides the list of the controller."""


def parse(texts: ProgramTexts) -> Parsed:
    """Parse the targets of .src files and of the .dat files with the same names."""
    blank = tuple(blanked(with_newlines(text), _BLANK) for text in texts.texts)
    reader = KrlReader(texts.names, blank, tuple(map(lines_of, blank)), Points(texts.own))
    reader.points.axes.update(*map(external_axes_in, blank))
    stated: dict[str, Value] = {}
    for file in (*reversed(range(texts.own)), *range(texts.own, len(blank))):
        for begin, line in lines_in(blank[file]):
            if file < texts.own or reader.is_config(file) or _GLOBAL.search(line):
                _declare(reader, file, begin, line)
    for file in range(len(blank)):
        _define(reader, file, stated)
    _watch_fdat(reader)
    for file, name in enumerate(texts.names):
        if name.lower().endswith(".src"):
            _read_module(reader, file)
        elif name.lower().endswith(".sub"):
            read_submit(reader, file)
    _watch_points(reader)

    def initial(part: str) -> Value:
        family, _, number = part.partition("[")
        if part in stated:
            return stated[part]
        if family in ("TOOL_DATA", "BASE_DATA"):
            return number.rstrip("]")
        if part in ("tool", "base", "fdat tool", "fdat base"):
            return Unknown(0, 0, "these files do not set the value earlier")
        return "checked" if part == LINES else OFF

    may_be_outside = any(_OUTSIDE.search(text) for text in blank)
    kept = ("TOOL_DATA[", "BASE_DATA[", "switch", CORRECTION, *(["external_tcp"] if may_be_outside else []))
    module = reader.modules[0]
    starts = f"{module}:{module.rpartition('/')[2]}" if texts.own <= 2 else None
    return reader.points.parsed(
        Program(reader.used_routines(), initial, tuple(reader.beside), kept=kept, starts=starts)
    )


def _read_module(reader: KrlReader, file: int) -> None:
    """Parse a .src file."""
    lines = [line for text in reader.module_texts(file) for _, line in lines_in(text)]
    names = {word.upper() for line in lines for word in _WORD.findall(line)}
    points = frozenset(name for name in names if reader.key(file, name))
    reader.copies, reader.constants = copies_in(lines, points), constants_in(lines)
    for begin, line in lines_in(reader.texts[file]):
        read_statement(reader, file, begin, line)
    reader.close()


def _define(reader: KrlReader, file: int, stated: dict[str, Value]) -> None:
    """Add the routines of a file and, from $config.dat, the numbers of tools and bases."""
    for begin, line in lines_in(reader.texts[file]):
        if routine := _ROUTINE.match(line):
            if not (is_of_maker(routine[2]) and reader.is_of_maker(file)):
                reader.define(file, routine[2].upper(), everywhere=bool(routine[1]))
        elif reader.is_config(file):
            if data := _DATA.fullmatch(line):
                _configured(reader, file, begin, data, stated)
        elif hides := _OWN_LIST.match(line):
            why = reader.why(file, begin, f"{hides[1]} is declared here and hides the controller's variable")
            reader.beside.append(Call("\0", why))


_COMPONENT = re.compile(r"[ \t]+[-+.\w'#$]")
"""What follows the name of a component in an aggregate: its value."""


def _watch_points(reader: KrlReader) -> None:
    """Mark points as changed if they appear outside a move or are imported under another name.

    A point of another file keeps its numbers, so only an assignment or a call can change its meaning.
    """
    for file, text in enumerate(reader.texts):
        for word in _WORD.finditer(text):
            if (file, word.start()) in reader.spent or _HOME.search(text, max(0, word.start() - 40), word.start()):
                continue
            if _COMPONENT.match(text, word.end()) and text[max(0, word.start() - 3) : word.start()].rstrip()[-1:] in (
                "{",
                ",",
            ):
                continue  # X of {X 100, Y 50}, not a point of this name
            for key in reader.mentioned(file, word[0], text[word.end() : word.end() + 20]):
                if reader.points.target(key).file < reader.points.files or _may_write(text, word):
                    reader.points.change(key, file, reader.lines[file].at(word.start()))
        for alias in _IMPORT.finditer(text):
            keys = reader.points.keys()
            for key in [key for key in keys if key.rpartition(":")[2] == alias[1].upper()]:
                reader.points.change(key, file, reader.lines[file].at(alias.start()))


def _may_write(text: str, word: re.Match[str]) -> bool:
    """Return whether a statement may write to a point: it is assigned, or an argument of a call."""
    before = text[text.rfind("\n", 0, word.start()) + 1 : word.start()]
    return bool(_WRITTEN.match(text, word.end())) or before.count("(") > before.count(")")


def _configured(reader: KrlReader, file: int, begin: int, data: re.Match[str], stated: dict[str, Value]) -> None:
    """Add the numbers of a tool or base in $config.dat."""
    frame = reader.frame(data[3])
    if frame is not None:
        value, kind = as_value(frame), data[1].upper()
        stated[f"{kind}[{data[2]}]"] = value
        line = reader.lines[file].at(begin)
        reader.points.state(NamedFrame(data[2], "tool" if kind == "TOOL_DATA" else "frame", file, line, value))


def _declare(reader: KrlReader, file: int, begin: int, line: str) -> None:
    """Add the points and the sets of tool and base declared in a line."""
    is_shared = reader.is_config(file) or bool(_GLOBAL.search(line))
    if fdat := _FDAT.match(line):
        name = reader.scoped(file, fdat[1], is_shared=is_shared)
        if name in reader.fdat:
            reader.fdat_written.add(name)
        reader.fdat[name] = fdat[2]
        return
    declared = _DECLARED.fullmatch(line)
    if not declared:
        if typed := _TYPED.fullmatch(line):
            names = _WORD.finditer(line, typed.start(1))
            reader.spent.update((file, begin + name.start()) for name in names)
        return
    inside = LITERAL_TYPE.sub(lambda prefix: " " * len(prefix[0]), declared["list"])
    key = reader.scoped(file, declared["name"], is_shared=is_shared)
    target, reason = reader.literal(file, begin + declared.start("list"), inside, declared["name"])
    if target and not (declared["index"] and reader.is_config(file)):
        reader.spent.add((file, begin + declared.start("name")))
        if declared["index"]:
            reader.arrays.setdefault(key, []).append(element := f"{key}[{int(declared['index'])}]")
            key, target = element, replace(target, name=f"{declared['name']}[{declared['index']}]")
        reader.points.declare(key, target, reason)


def _watch_fdat(reader: KrlReader) -> None:
    """Mark the sets of tool and base that the program writes to as unknown."""
    for file, text in enumerate(reader.texts):
        for _, line in lines_in(text):
            for word in _WORD.finditer(line):
                if (name := reader.fdat_name(file, word[0])) is None:
                    continue
                taken = _TAKEN.search(line[: word.start()])
                # A routine of the program with this name may write to it.
                if not taken or (taken[1] and reader.defined(file, taken[1])):
                    reader.fdat_written.add(name)


READER = ProgramReader(
    parse,
    _DECIMALS,
    Remark("; ", before={".dat": re.compile(rb"^[ \t]*ENDDAT\b", re.MULTILINE | re.IGNORECASE)}),
    null_tools=("0",),
    null_frames=("0",),
    of_world=True,
    beside=(".src", ".dat", ".sub"),
    backup="R1",
    is_together=True,
    is_of_maker=is_file_of_maker,
    empty="DEF {0}()\nEND\n",
)
