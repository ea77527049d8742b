r"""Reader of targets in RAPID: jointtarget in degrees, and robtarget in mm with a quaternion.

Source: ABB, Technical reference manual, RAPID Instructions, Functions and Data types (3HAC050917). Confdata selects the
posture, except after ConfL\Off for lines and ConfJ\Off for joint moves: the arm then keeps its posture. tool0 is the
flange, and wobj0 is the world, assumed to be the robot's base. Other modules in the directory are read for the
routines, tools and work objects they declare.
"""

from __future__ import annotations

import re
from functools import partial
from typing import Literal

import numpy as np

from analysis.apps.makers.abb.statements import EXTERNAL_AXES, NO_AXIS, WORD, RapidStatements, literal_frames
from analysis.apps.makers.numbers import Decimals
from analysis.apps.makers.points import as_value
from analysis.apps.makers.program_machine import OFF, Set, Unknown, Value, called_routines, reachable
from analysis.apps.makers.program_parser import NUMBER, brackets
from analysis.apps.makers.program_reader import ProgramReader, Remark
from analysis.apps.makers.target import NamedFrame, Notice, Parsed, ProgramTexts

_DECIMALS = Decimals(place=(4, 7), turn=(8, 12))
"""0.1 µm, and 1e-8 of a quaternion or of a degree: a num has about seven digits."""
_END = re.compile(rb"^[ \t]*ENDMODULE\b", re.MULTILINE | re.IGNORECASE)
_DATA = re.compile(
    r"(?<![\w\\])(?P<scope>local\s+|task\s+)?(?P<storage>const|pers|var)\s+(?P<kind>\w+)\s+(?P<name>\w+)\s*"
    r"(?P<array>\{[^{};]*\}\s*)?(?::=(?P<value>[^;]*))?;"
)
_ELEMENT = re.compile(r"\[(?=\s*\[\s*[-+.\d])")
"""Start of a target in the value of an array: [[x, y, z], …] or [[q1, …, q6], …]."""
_MOST_ELEMENTS = 20
"""Size of an array of points that is traced: a move to a variable element leads from and to any other."""
_PARAMETERS = re.compile(r"\b(?:proc|func\s+\w+)\s+\w+\s*\(([^()]*)\)")
_LAST = re.compile(r",\s*([a-z]\w*)\s*(?=[\\;])")
_WOBJ = re.compile(r"\\\s*wobj\s*:=\s*(\w+)")
_MAIN = re.compile(r"\bproc\s+main\s*\(")
_COORDINATES = re.compile(rf"\[((?:\s*{NUMBER}\s*,){{5}}\s*{NUMBER}\s*)\]\s*\]")
_EXTERNAL_MOVED = re.compile(r"\b(?:moveextj|searchextj|ind[arcd]move)\b|\.\s*(?:extax|eax_[a-f])\b")
"""Motion of any external axes."""
_OFFSET_EXTERNAL = re.compile(r"\beoffs(?:on|set)\b")
"""Offset of external axes: only targets that name an axis are affected."""
_ANY_AXIS = "any"
"""Placeholder for the axes moved by an instruction that does not name the axes."""


class _RapidReader(RapidStatements):
    """The declarations of points, tools and work objects, and what hides, shares or writes to them."""

    def __init__(self, program: ProgramTexts) -> None:
        super().__init__(program)
        # tool0 and wobj0 belong to the system module BASE.sys, which may be in the same directory.
        self.stated: dict[str, Value] = dict.fromkeys(("tool tool0", "frame wobj0"), as_value(np.eye(4)))
        self.shared_by: dict[str, int] = dict.fromkeys(self.stated, len(self.texts))
        """The module whose persistent tool or work object other tasks may declare again."""
        self.first_in: dict[str, int] = {}
        """The modules that first declare tools and work objects for all modules."""
        self.numeric: dict[str, NamedFrame] = {}
        """The tools and work objects whose numbers are those of their declaration."""
        for text in self.texts:
            self.frames |= {f"tool {name}" for name in _LAST.findall(text)}
            self.frames |= {f"frame {name}" for name in _WOBJ.findall(text)}

    def declare(self, file: int) -> None:
        self.file, declares = file, set()
        for declared in _DATA.finditer(self.text):
            self.at = declared.start("name")
            kind, name = declared["kind"], declared["name"]
            is_shared = (declared["scope"] or "").strip() != "local"
            declares.add(name)
            if kind in ("tooldata", "wobjdata"):
                self._declare_frame(kind, declared, is_shared)
            elif kind in ("robtarget", "jointtarget") and self.is_own and declared["value"]:
                target = None if declared["array"] else self.literal(kind, *declared.span("value"), declared["name"])
                if target:
                    self.points.declare(name, target)
                if target or (declared["array"] and self._declare_array(kind, declared)):
                    self.spent.add((file, self.at))
                    self.shared |= {name} if is_shared else set()
            elif kind in ("robtarget", "jointtarget") and self.is_own and not declared["array"]:
                self._declare_assigned(kind, declared["name"], is_shared)
        self.declares.append(declares)

    def _declare_assigned(self, kind: str, name: str, is_shared: bool) -> None:
        """Add a point that is declared without a value and assigned with numbers. A second assignment changes it."""
        for assigned in re.finditer(rf"(?<![\w.]){name}\s*:=(?P<value>[^;]*)", self.text):
            target = self.literal(kind, *assigned.span("value"), name)
            if target and (self.file, assigned.start()) not in self.spent:
                self.spent |= {(self.file, self.at), (self.file, assigned.start())}
                self.points.declare(name, target)
                self.shared |= {name} if is_shared else set()

    def _declare_array(self, kind: str, declared: re.Match[str]) -> bool:
        """Add the elements of an array as points if rig can trace it: one dimension, numbers, and not too many."""
        begin, end = declared.span("value")
        closes = brackets(self.text, begin, end)
        starts = [found.start() for found in _ELEMENT.finditer(self.text, begin, end)]
        targets = [
            self.literal(kind, start, closes.get(start, begin) + 1, f"{self.as_written(declared['name'])}{{{k}}}")
            for k, start in enumerate(starts, start=1)
        ]
        size = re.fullmatch(r"\{\s*(\d+)\s*\}\s*", declared["array"])
        if size and 0 < len(targets) == int(size[1]) <= _MOST_ELEMENTS and all(targets):
            name = declared["name"]
            self.arrays[name] = [f"{name}{{{k}}}" for k in range(1, len(targets) + 1)]
            for key, target in zip(self.arrays[name], filter(None, targets), strict=True):
                self.points.declare(key, target)
            return True
        for start in starts:
            self.list_left("array", declared["name"], start)
        return False

    def _declare_frame(self, kind: str, declared: re.Match[str], is_shared: bool) -> None:
        """Add a tool or work object.

        A name declared twice is unknown, except for persistent data shared by tasks with the same numbers. Two modules
        that declare a global name with different numbers are variants or different tasks: the user states the frame.
        """
        family: Literal["tool", "frame"] = "tool" if kind == "tooldata" else "frame"
        name = self.as_written(declared["name"])
        variable = f"{family} {declared['name']}"
        self.frames.add(variable)
        frame = literal_frames(kind, declared["value"] or "")
        value: Value = self.why(f"{name} is not declared with numbers, on the robot")
        if frame is not None:
            value = as_value(frame)
        elif declared["value"] is None:
            value = declared["name"]
        shared_by = self.file if is_shared and declared["storage"] == "pers" else -1
        if variable not in self.stated:
            self.stated[variable], self.shared_by[variable] = value, shared_by
            if is_shared:
                self.first_in[variable] = self.file
            if frame is not None:
                self.numeric[variable] = NamedFrame(name, family, self.file, self.line(), as_value(frame))
        elif is_shared and self.first_in.get(variable, self.file) != self.file:
            if value != self.stated[variable]:
                self.stated[variable] = declared["name"]
                self.numeric.pop(variable, None)
                fact = f"{name} has other numbers in {self.names[self.first_in[variable]]}; state --{family} {name}"
                self.points.notices.append(Notice(self.file, self.line(), fact))
        elif (
            value != self.stated[variable]
            or -1 in (shared_by, self.shared_by[variable])
            or self.file == self.shared_by[variable]
        ):
            self.shadowed[variable] = self.why(f"{name} is declared twice")

    def find_external_axes(self) -> None:
        """Add the external axes that the program moves. An axis that every target names with one value does not move.

        Other modules with a main routine belong to other programs.
        """
        has_main = [_MAIN.search(text) is not None for text in self.texts]
        any_main = any(has_main[: self.own])
        is_part = [file < self.own or not (any_main and is_main) for file, is_main in enumerate(has_main)]
        together = "\n".join(text for text, part in zip(self.texts, is_part, strict=True) if part)
        rows = [tuple(map(float, found[1].split(","))) for found in _COORDINATES.finditer(together)]
        for axis, column in zip(EXTERNAL_AXES, zip(*rows, strict=True), strict=bool(rows)):
            values = {min(value, NO_AXIS) for value in column}
            if len(values) > 1 and values - {0.0, NO_AXIS}:
                self.points.axes.add(axis)
            elif not values & {0.0, NO_AXIS}:
                fact = f"external axis {axis} is at {column[0]:g} in every target; rig assumes that it does not carry"
                self.points.notices.append(Notice(0, 1, f"{fact} the arm"))
        names_any = any(value < NO_AXIS for row in rows for value in row)
        if _EXTERNAL_MOVED.search(together) or (names_any and _OFFSET_EXTERNAL.search(together)):
            self.points.axes.add(_ANY_AXIS)

    def hide_by_parameters(self) -> None:
        """Make tools and work objects unknown if a parameter of a routine has the same name."""
        for file, text in enumerate(self.texts):
            self.file = file
            for parameters in _PARAMETERS.finditer(text):
                for word in WORD.finditer(text, *parameters.span(1)):
                    why = self.why(f"{word[0]} is a parameter of a routine", word.start())
                    self.shadowed |= {f"{kind} {word[0]}": why for kind in ("tool", "frame")}

    def add_other_tasks(self) -> None:
        """Add the tools and work objects set by other tasks: their main routine calls none of these routines.

        Tasks may share persistent data of the same name.
        """
        own = {name for file in range(self.own) for name in self.routines if name.startswith(f"{file}:")}
        for file in range(self.own, len(self.texts)):
            why = Unknown(file, 1, f"the main routine of {self.names[file]} may run in parallel")
            reached = set(reachable(self.routines, [f"{file}:main"]))
            if reached & own and not any(name.endswith(":main") for name in own):
                continue  # the main routine of this task
            for name in sorted(reached):
                parts = [of for of in self.routines[name] if isinstance(of, Set)]
                sets = [of for of in parts if of.variable.startswith(("tool ", "frame "))]
                self.concurrently(why, partial(self.add, *sets))

    def watch_points(self) -> None:
        for word in self.mentions(WORD):
            name = word[0]
            if self.is_own or (name in self.shared and name not in self.declares[self.file]):
                for key in self.arrays.get(name, [name]):
                    self.change(key)
        if self.by_name:
            for key in list(self.points.declared):
                self.points.change(key, self.by_name.file, self.by_name.line)

    def first_routine(self) -> str | None:
        """The routine with which the operator starts: main, or the only one that no other calls."""
        called = called_routines(self.routines.values()) | {call.name for call in (*self.beside, *self.broken)}
        own = [name for file in range(self.own) for name in self.routines if name.startswith(f"{file}:")]
        first = [name for name in own if name.endswith(":main")] or [name for name in own if name not in called]
        return first[0] if len(first) == 1 else None

    def initial(self, variable: str) -> Value:
        kind, _, name = variable.partition(" ")
        if kind in ("tool", "frame"):
            return self.stated.get(variable, name)
        return "on" if kind == "conf" else OFF


def parse(program: ProgramTexts) -> Parsed:
    reader = _RapidReader(program)
    files = range(len(program.texts))
    for file in files:
        reader.declare(file)
    for named in reader.numeric.values():
        reader.points.sets.append(named)
    reader.find_copies()
    reader.find_external_axes()
    reader.hide_by_parameters()
    for file in files:
        reader.read_module(file)
    reader.add_other_tasks()
    reader.watch_points()
    return reader.points.parsed(reader.program(kept=("tool ", "frame "), cycles=True, starts=reader.first_routine()))


READER = ProgramReader(
    parse,
    _DECIMALS,
    Remark("  ! ", before=dict.fromkeys((".mod", ".modx", ".prg"), _END)),
    beside=(".mod", ".modx", ".prg", ".sys", ".sysx"),
    backup=r"TASK\d+|T_ROB\d+",
    empty="MODULE {0}_stated\nPROC {0}()\nENDPROC\nENDMODULE\n",
)
