"""Offsets of Offs and RelTool, and copies of points: pAbove:=Offs(pPick,0,0,100).

An offset is known from numbers, constants, variables that nothing writes, and loops with known bounds. A variable is a
copy only if the texts assign it once, from a point with a known offset, and otherwise only move to it.
"""

from __future__ import annotations

import ast
import itertools
import operator
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from analysis.apps.makers.abb.instructions import MOVE
from analysis.apps.makers.arithmetic import Operators, tree_of, value_of
from analysis.apps.makers.numbers import frame_of
from analysis.apps.makers.program_parser import LOWER_CASE, ProgramParser, arguments
from analysis.apps.makers.target import ProgramTexts
from analysis.robot.kinematics.arm import Array

_BLANK = re.compile(r"\"[^\"\n]*\"|![^\n]*|%%%[^%]*%%%")
_MOST_POSITIONS = 8
"""Positions of a move in loops. Of more positions, the corners of the pattern are taken: between them the correction
changes smoothly."""
_LONGEST_LOOP = 1000
_TURN = re.compile(r"\\\s*r([xyz])\s*:=(.*)", re.DOTALL)
_LOOP = re.compile(r"\s*(\w+)\s+from\b(.*?)\bto\b(.*?)(?:\bstep\b(.*?))?\bdo\b", re.DOTALL)
_DIV_MOD = re.compile(r"\b(div|mod)\b")
_OPERATORS: Operators = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv, ast.Mod: operator.mod,
}  # fmt: skip


@dataclass
class Numbers:
    """Numbers known from the texts, and the values of the loop variables around a statement, by name in lower case."""

    known: dict[str, float] = field(default_factory=dict)
    loops: list[tuple[str, tuple[float, ...] | None]] = field(default_factory=list)
    """None if the bounds of the loop are unknown."""

    def enter(self, header: str) -> None:
        """Enter a loop, given the text "i FROM 1 TO n STEP 1 DO"."""
        loop, values = _LOOP.fullmatch(header), None
        bounds = [self.value(text or "1") for text in loop.groups()[1:]] if loop else []
        known = [bound for bound in bounds if bound is not None]
        if len(known) == 3:
            first, last, step = known
            count = int(np.floor((last - first) / step + 1e-9)) + 1 if step else 0
            if 0 < count <= _LONGEST_LOOP:
                values = tuple(first + step * k for k in range(count))
        self.loops.append((loop[1] if loop else "", values))

    def value(self, text: str) -> float | None:
        values = self.every_value([text])
        return values[0][0] if len(values) == 1 else None

    def every_value(self, texts: Sequence[str], *, corners: bool = True) -> list[tuple[float, ...]]:
        """Possible values of expressions, together for each pass of the loops; none if any is unknown.

        corners: take the first and last values of loops with too many passes, instead of none.
        """
        python = [_DIV_MOD.sub(lambda word: "//" if word[1] == "div" else "%", text) for text in texts]
        trees = [tree_of(" ".join(text.split())) for text in python]
        used = {node.id for tree in trees if tree for node in ast.walk(tree) if isinstance(node, ast.Name)}
        loops = {name: values for name, values in self.loops if name in used}
        if None in trees or None in loops.values() or not used <= self.known.keys() | loops.keys():
            return []
        ranges = [values for values in loops.values() if values]
        if np.prod([len(values) for values in ranges]) > _MOST_POSITIONS:
            if not corners:
                return []
            ranges = [tuple(dict.fromkeys((values[0], values[-1]))) for values in ranges]
        passes = [self.known | dict(zip(loops, one, strict=True)) for one in itertools.product(*ranges)]
        try:
            found = [tuple(value_of(tree, names, _OPERATORS) for tree in trees if tree) for names in passes]
        except (ZeroDivisionError, KeyError, OverflowError):
            return []
        return list(dict.fromkeys(found))


def offset_frames(function: str, texts: Sequence[str], numbers: Numbers) -> list[Array]:
    """Possible frames (4, 4) in mm of the arguments of "offs" or "reltool" (about x, the new y, the new z)."""
    parts = [part.strip(" \n\t,") for part in re.split(r"(?=\\)", ",".join(texts))]
    places, turns = parts[0].split(","), {"x": "0", "y": "0", "z": "0"}
    for text in parts[1:]:
        turn = _TURN.fullmatch(text)
        if function != "reltool" or not turn:
            return []
        turns[turn[1]] = turn[2]
    if len(places) != 3:
        return []
    frames = []
    for x, y, z, *turned in numbers.every_value([*places, *turns.values()]):
        T = frame_of("roll_pitch_yaw", [0, 0, 0, *(-turn for turn in turned)]).T  # Inverse of the rotation
        T[:3, 3] = x, y, z
        frames.append(T)
    return frames


_NUM = re.compile(
    r"(?<![\w\\])(?:local\s+|task\s+)?(?P<storage>const|pers|var)\s+num\s+(?P<name>\w+)\s*(?P<value>:=[^;]*)?;"
)
_READ_BEFORE, _READ_AFTER = tuple("+-*/<>="), tuple("+-*/<>")


def known_numbers(texts: Sequence[str]) -> dict[str, float]:
    """Numbers that are declared once with a value, and only used in calculations, comparisons, offsets and the bounds
    of loops."""
    declared: dict[str, list[re.Match[str]]] = {}
    for text in texts:
        for found in _NUM.finditer(text):
            declared.setdefault(found["name"], []).append(found)
    together = "\n".join(texts)
    known = Numbers()
    for name, every in declared.items():
        only = every[0]
        if len(every) == 1 and only["value"] and (only["storage"] == "const" or _only_read(name, together)):
            value = known.value(only["value"][2:])
            if value is not None:
                known.known[name] = value
    # A parameter of a routine or other data may also have the name.
    declared_as = Counter(re.findall(r"\b(?:num|dnum|bool|string|robtarget|switch|intnum)\s+(\w+)\b", together))
    return {name: value for name, value in known.known.items() if declared_as[name] <= 1}


def _only_read(name: str, text: str) -> bool:
    for word in re.finditer(rf"\b{name}\b", text):
        before, after = text[: word.start()].rstrip(), text[word.end() :].lstrip()
        if re.search(r"\bnum$", before):  # The declaration
            continue
        if after.startswith((":", "{", ".")):
            return False
        inside = re.search(r"\b(?:offs|reltool)\s*\([^;]*$|\b(?:from|to|step)$", before)
        compared = after.startswith("=") or after.startswith(_READ_AFTER) or before.endswith(_READ_BEFORE)
        if not (inside or compared):
            return False
    return True


OFFSET = re.compile(r"(offs|reltool)\s*\(")
_ASSIGNED = re.compile(r"(?<![\w.{}])(?P<name>[a-z]\w*)\s*:=\s*(?P<value>[^;]*?)\s*(?=;|$)")
_DECLARED = re.compile(r"\brobtarget\s+(\w+)")
_DECLARES = re.compile(r"\brobtarget\s+$")
_FIRST_WORD = re.compile(r"\s*([a-z]\w*)")


@dataclass(frozen=True)
class Reached:
    """The point that a target refers to, with its range in the text."""

    point: str
    begin: int
    end: int
    offsets: tuple[tuple[str, Array], ...] | None = ()
    """Possible offsets: kind, "frame" or "tool", and frame (4, 4) in mm. Empty if the point itself is reached, None if
    unknown."""


class RapidOffsets(ProgramParser):
    """A program in RAPID, in lower case, because RAPID ignores the case."""

    def __init__(self, program: ProgramTexts) -> None:
        super().__init__(program, _BLANK, LOWER_CASE)
        self.numbers = Numbers(known_numbers(self.texts))
        self.copies: dict[str, Reached] = {}

    @property
    def text(self) -> str:
        return self.texts[self.file]

    def reached(self, begin: int, end: int) -> Reached:
        text, wrapped = self.text, OFFSET.match(self.text, begin, end)
        if wrapped is None:
            name = text[begin:end].partition("\\")[0].strip()
            copy = self.copies.get(name, Reached(name, begin, end))
            return Reached(copy.point, begin, end, copy.offsets)
        places = arguments(text, wrapped.end(), text.rfind(")", begin, end))
        inner = self.reached(*places[0])
        frames = offset_frames(wrapped[1], [text[slice(*place)] for place in places[1:]], self.numbers)
        kind = "frame" if wrapped[1] == "offs" else "tool"
        if not frames or inner.offsets is None or any(of != kind for of, _ in inner.offsets):
            return Reached(inner.point, inner.begin, inner.end, None)
        before = [T for _, T in inner.offsets] or [np.eye(4)]
        joined = [T @ outer if kind == "tool" else outer @ T for T in before for outer in frames]
        return Reached(inner.point, inner.begin, inner.end, tuple((kind, T) for T in joined))

    def find_copies(self) -> None:
        points, found = self.points.declared, dict[str, list[tuple[int, Reached]]]()
        for file, text in enumerate(self.texts):
            self.file = file
            for assigned in _ASSIGNED.finditer(text):
                value = self.reached(*assigned.span("value"))
                found.setdefault(assigned["name"], []).append((file, value))
        declared = [word for text in self.texts for word in _DECLARED.findall(text)]
        for name, every in found.items():
            file, value = every[0]
            single = len(every) == 1 and declared.count(name) == 1 and name not in points
            if single and value.point in points and value.offsets is not None and _is_only_reached(name, self.texts):
                self.copies[name] = value if value.offsets else Reached(value.point, 0, 0, (("frame", np.eye(4)),))
                self.spent.add((file, value.begin))


def _is_only_reached(name: str, texts: Sequence[str]) -> bool:
    for text in texts:
        for word in re.finditer(rf"(?<![a-z\d_]){name}(?!\w)", text):
            begin = max(text.rfind(mark, 0, word.start()) for mark in ";\n") + 1
            first = _FIRST_WORD.match(text, begin)
            move = MOVE.fullmatch(first[1]) if first else None
            is_written = re.match(r"\s*:=", text[word.end() : word.end() + 20])
            is_declared = _DECLARES.search(text[max(0, word.start() - 40) : word.start()])
            if text.startswith((".", "{"), word.end()):  # A part of it
                return False
            if not (is_written or is_declared or (move and not move["search"])):
                return False
    return True
