"""Reader of targets in KRL: E6AXIS and AXIS in degrees; E6POS, POS and FRAME in mm and degrees.

Source: KUKA System Software 8.x, Operating and Programming Instructions for System Integrators, and public programs
with the inline forms of the pendant (FDAT_ACT = F…, PTP X…, SLIN … WITH $TOOL = STOOL2(F…)). The numbers of tools and
bases are in $config.dat: the user states them, or copies that file into the directory of the program. $NULLFRAME and
base 0 are $WORLD, in which $machine.dat of a backup states the robot's foot ($ROBROOT). Without this file, both are
assumed to be the same if the arm is upright, as KUKA delivers it.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from analysis.apps.makers.kuka.backup import other_arm
from analysis.apps.makers.kuka.closed_lists import is_file_of_maker, is_of_maker
from analysis.apps.makers.kuka.positions import EXTERNAL_AXES
from analysis.apps.makers.kuka.statements import (
    CORRECTION,
    ELEMENT,
    ROUTINE,
    KrlStatements,
)
from analysis.apps.makers.numbers import Decimals
from analysis.apps.makers.points import as_frame, as_value
from analysis.apps.makers.program_machine import OFF, Call, Unknown, Value, reachable
from analysis.apps.makers.program_parser import NUMBER
from analysis.apps.makers.program_reader import ProgramReader, Remark
from analysis.apps.makers.target import Parsed, ProgramTexts
from analysis.robot.kinematics.arm import Array

_DECIMALS = Decimals(place=(4, 7), turn=(6, 9))
"""0.1 µm and 1e-6°, which is 0.02 µm at 1 m. A REAL of KRL has about seven digits."""
_SCOPE = r"\s*(?:(?:DECL|GLOBAL|CONST)\s+)*"
_TYPES = "(?:E6POS|POS|FRAME|E6AXIS|AXIS)"
_DECLARED = re.compile(
    rf"{_SCOPE}(?:{_TYPES}\s+)?(?P<name>(?!(?:TOOL|BASE)_DATA\b)[A-Z_]\w*)(?:\s*\[\s*(?P<index>\d+)\s*\])?\s*="
    r"\s*\{(?P<list>[^{}]*)\}\s*"
)
_TYPED = re.compile(rf"{_SCOPE}{_TYPES}\s+([\w\s,\[\]]+)")
_FDAT = re.compile(rf"{_SCOPE}FDAT\s+(\w+)\s*=\s*\{{([^{{}}]*)\}}?")
_DATA = re.compile(r"\s*(TOOL_DATA|BASE_DATA)\s*\[\s*(\d+)\s*\]\s*=\s*(\{[^{}]*\})\s*")
_OWN_LIST = re.compile(rf"{_SCOPE}FRAME\s+(?:.*,\s*)?(TOOL_DATA|BASE_DATA)\b")
"""A list of tools or bases that hides the list of the controller."""
_EXTERNAL_MOVED = re.compile(rf"(?<![\w$.])(E[1-6])\s+({NUMBER})|\.\s*(E[1-6])\b|\bASYPTP\b|\$EX_AX_\w+|\$ASYNC_\w+")
_GLOBAL = re.compile(r"\bGLOBAL\b")
_WORD = re.compile(r"[A-Za-z_]\w*")
_TAKEN = re.compile(r"(?:FDAT_ACT\s*=|\bFDAT|\b(S(?:TOOL2?|BASE|IPO_MODE|LOAD))\s*\()\s*$")
"""Text before a set of tool and base that is read but not written."""
_IMPORT = re.compile(r"\bIMPORT\b[^\n]*\.\.\s*(\w+)")
"""Import, which gives a point another name that other programs can write to."""
_HOME = re.compile(r"\$H_POS\s*=\s*$")
"""Text before a point that becomes the home position, which follows the correction of the point."""
_OUTSIDE = re.compile(r"\$IPO_MODE\s*=(?!\s*#BASE\b)|\bIPO_FRAME\s+#(?!BASE\b)")
"""Text that may select a tool fixed outside of the robot."""
_WRITTEN = re.compile(r"(?:\s*\[[^\]\n]*\])?(?:\.\w+)*[ \t]*=(?!=)")
_COMPONENT = re.compile(r"[ \t]+[-+.\w'#$]")


class _KrlReader(KrlStatements):
    """The declarations of points, routines, tools and bases, and what writes to them."""

    def __init__(self, program: ProgramTexts) -> None:
        super().__init__(program)
        self.arrays: dict[str, list[str]] = {}
        self.stated: dict[str, Value] = {}
        for text in self.texts:
            for mention in _EXTERNAL_MOVED.finditer(text):
                if mention[3]:
                    self.points.axes.add(mention[3])
                elif not mention[1]:
                    self.points.axes.update(EXTERNAL_AXES)
                elif float(mention[2]):
                    self.points.axes.add(mention[1])

    @property
    def is_config(self) -> bool:
        """True for $config.dat, whose data are visible everywhere."""
        return self.module.rpartition("/")[2] == "$CONFIG"

    @property
    def is_of_maker(self) -> bool:
        return not self.is_own and is_file_of_maker(self.names[self.file])

    def declare_points(self, line: str) -> None:
        is_shared = self.is_config or bool(_GLOBAL.search(line))
        if not (self.is_own or is_shared):
            return
        if fdat := _FDAT.match(line):
            name = self.scopes(fdat[1])[is_shared]
            if name in self.fdat:
                self.fdat_written.add(name)
            self.fdat[name] = fdat[2]
        elif declared := _DECLARED.fullmatch(line):
            key, index = self.scopes(declared["name"])[is_shared], declared["index"]
            target, reason = self.literal(declared["list"], declared.start("list"), declared["name"])
            if target and not (index and self.is_config):
                self.spent.add((self.file, self.at + declared.start("name")))
                if index:
                    self.arrays.setdefault(key, []).append(element := f"{key}[{int(index)}]")
                    key, target = element, replace(target, name=f"{target.name}[{index}]")
                self.points.declare(key, target, reason)
        elif typed := _TYPED.fullmatch(line):
            names = _WORD.finditer(line, typed.start(1))
            self.spent.update((self.file, self.at + name.start()) for name in names)

    def define(self, line: str) -> None:
        """Add a routine or, from $config.dat, the numbers of a tool or base.

        All files see global routines and those named like their file.
        """
        if routine := ROUTINE.match(line):
            if not (self.is_of_maker and is_of_maker(routine[2])):
                own, everywhere = self.scopes(routine[2])
                self.defined.setdefault(own, []).append(own)
                if routine[1] or self.module.rpartition("/")[2] == everywhere:
                    self.defined.setdefault(everywhere, []).append(own)
        elif self.is_config:
            if (data := _DATA.fullmatch(line)) and (frame := self.frame(data[3])) is not None:
                self.stated[f"{data[1]}[{data[2]}]"] = as_value(frame)
                self.state(data[1], data[2], frame)
        elif hides := _OWN_LIST.match(line):
            why = self.why(f"{hides[1]} is declared here and hides the controller's variable")
            self.beside.append(Call("\0", why))

    def watch_fdat(self, line: str) -> None:
        """Mark the sets of tool and base that the program writes to as unknown."""
        for word in _WORD.finditer(line):
            if name := next((scope for scope in self.scopes(word[0]) if scope in self.fdat), None):
                taken = _TAKEN.search(line[: word.start()])
                # A routine of the program with this name may write to it.
                if not taken or (taken[1] and self.named(taken[1])):
                    self.fdat_written.add(name)

    def read_module(self, file: int) -> None:
        module = [other for other, name in enumerate(self.modules) if name == self.modules[file]]
        lines = [line for other in module for line in self.texts[other].split("\n")]
        self.file = file
        self.find_copies(lines)
        for line in self.lines(file):
            self.statement(line)
        self.end_routine()

    def watch_points(self) -> None:
        """Mark points as changed if they appear outside a move or are imported under another name."""
        for word in self.mentions(_WORD):
            text = self.texts[self.file]
            in_aggregate = text[max(0, word.start() - 3) : word.start()].rstrip()[-1:] in ("{", ",")
            if _HOME.search(text, max(0, word.start() - 40), word.start()) or (
                in_aggregate and _COMPONENT.match(text, word.end())  # X of {X 100, Y 50}, not a point of this name
            ):
                continue
            for key in self._mentioned(word[0], text[word.end() : word.end() + 20]):
                # Another file's point changes if it is assigned, or is an argument of a call.
                before = text[text.rfind("\n", 0, word.start()) + 1 : word.start()]
                is_written = _WRITTEN.match(text, word.end()) or before.count("(") > before.count(")")
                if self.points.declared[key].target.file < self.own or is_written:
                    self.change(key)
        for alias in self.mentions(_IMPORT):
            for key in [key for key in self.points.declared if key.rpartition(":")[2] == alias[1]]:
                self.change(key)

    def _mentioned(self, name: str, after: str) -> list[str]:
        """Points that a name and the text after it may refer to: all of an array if the index is not a number."""
        if key := self.key(name):
            return [key]
        elements = next((self.arrays[scope] for scope in self.scopes(name) if scope in self.arrays), [])
        index = ELEMENT.match(after)
        return [key for key in elements if not index or key.endswith(f"[{int(index[1])}]")]

    def drop_unused_routines(self) -> None:
        of_maker = set[str]()
        for file, module in enumerate(self.modules):
            self.file = file
            of_maker |= {module} if self.is_of_maker else set()
        of_user = [name for name in self.routines if name.partition(":")[0] not in of_maker]
        used = reachable(self.routines, [*of_user, *(call.name for call in self.beside)])
        self.routines = {name: body for name, body in self.routines.items() if name in used}

    def state(self, family: str, number: str, frame: Array) -> None:
        if family == "BASE_DATA" and isinstance(self.foot, tuple):
            frame = np.linalg.inv(as_frame(self.foot)) @ frame
        super().state(family, number, frame)

    def initial(self, variable: str) -> Value:
        family, _, number = variable.partition("[")
        if variable in self.stated:
            return self.stated[variable]
        if family in ("TOOL_DATA", "BASE_DATA"):
            return number.rstrip("]")
        if variable in ("tool", "base", "fdat tool", "fdat base"):
            return Unknown(0, 0, "these files do not set the value earlier")
        return OFF


def parse(program: ProgramTexts) -> Parsed:
    reader = _KrlReader(program)
    files, own = range(len(program.texts)), program.own
    for file in (*reversed(range(own)), *files[own:]):
        for line in reader.lines(file):
            reader.declare_points(line)
    for step in (reader.define, reader.watch_fdat):
        for file in files:
            for line in reader.lines(file):
                step(line)
    for file, name in enumerate(program.names):
        if name.lower().endswith(".src"):
            reader.read_module(file)
        elif name.lower().endswith(".sub"):
            for line in reader.lines(file):
                reader.submit(line)
    reader.watch_points()
    reader.drop_unused_routines()
    may_be_outside = any(_OUTSIDE.search(text) for text in reader.texts)
    kept = ("TOOL_DATA[", "BASE_DATA[", "switch", CORRECTION, *(["external_tcp"] if may_be_outside else []))
    module = reader.modules[0]
    starts = f"{module}:{module.rpartition('/')[2]}" if own <= 2 else None
    return reader.points.parsed(reader.program(kept=kept, starts=starts), reader.foot)


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
    other_arm=other_arm,
    empty="DEF {0}()\nEND\n",
)
