"""Copies of points in RAPID: pAbove:=Offs(pPick,0,0,100), and offsets in one another.

A move to a copy reaches the point with an offset. A variable counts as a copy only if the texts assign it once, from a
point with a known offset, and otherwise mention it only in moves.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.apps.makers.abb.instructions import MOVE
from analysis.apps.makers.abb.offsets import Numbers, offset_frames
from analysis.apps.makers.program_parser import arguments
from analysis.robot.kinematics.arm import Array

OFFSET = re.compile(r"(Offs|RelTool)\s*\(", re.IGNORECASE)
_ASSIGNED = re.compile(r"(?<![\w.{}])(?P<name>[A-Za-z]\w*)\s*:=\s*(?P<value>[^;]*?)\s*(?=;|$)")
_DECLARED = re.compile(r"\brobtarget\s+(\w+)", re.IGNORECASE)
"""A declaration of a variable or of a parameter."""
_DECLARES = re.compile(r"\brobtarget\s+$", re.IGNORECASE)
_FIRST_WORD = re.compile(r"\s*([A-Za-z]\w*)")


@dataclass(frozen=True)
class Reached:
    """The point that a target refers to, with its range in the text."""

    point: str
    begin: int
    end: int
    offsets: tuple[tuple[str, Array], ...] | None = ()
    """Possible offsets: kind, "frame" or "tool", and frame (4, 4) in mm. Empty if the point itself is reached, None if
    unknown."""


def read_target(text: str, begin: int, end: int, numbers: Numbers, copies: dict[str, Reached]) -> Reached:
    """Resolve nested offsets and the copies of a target."""
    wrapped = OFFSET.match(text, begin, end)
    if wrapped is None:
        name = text[begin:end].partition("\\")[0].strip().lower()
        copy = copies.get(name, Reached(name, begin, end))
        return Reached(copy.point, begin, end, copy.offsets)
    places = arguments(text, wrapped.end(), text.rfind(")", begin, end))
    inner = read_target(text, *places[0], numbers, copies)
    function = wrapped[1].lower()
    frames = offset_frames(function, [text[slice(*place)] for place in places[1:]], numbers)
    kind = "frame" if function == "offs" else "tool"
    if not frames or inner.offsets is None or any(of != kind for of, _ in inner.offsets):
        return Reached(inner.point, inner.begin, inner.end, None)
    before = [T for _, T in inner.offsets] or [np.eye(4)]
    joined = [T @ outer if kind == "tool" else outer @ T for T in before for outer in frames]
    return Reached(inner.point, inner.begin, inner.end, tuple((kind, T) for T in joined))


def copies_in(
    texts: Sequence[str], numbers: Numbers, points: frozenset[str]
) -> tuple[dict[str, Reached], set[tuple[int, int]]]:
    """Copies by name in lower case, and the places (file, position) at which they read their points."""
    found: dict[str, list[tuple[int, Reached]]] = {}
    for file, text in enumerate(texts):
        for assigned in _ASSIGNED.finditer(text):
            value = read_target(text, *assigned.span("value"), numbers, {})
            found.setdefault(assigned["name"].lower(), []).append((file, value))
    declared = [word.lower() for text in texts for word in _DECLARED.findall(text)]
    copies, read = dict[str, Reached](), set[tuple[int, int]]()
    for name, every in found.items():
        file, value = every[0]
        single = len(every) == 1 and declared.count(name) == 1 and name not in points
        if single and value.point in points and value.offsets is not None and _is_only_reached(name, texts):
            copies[name] = value if value.offsets else Reached(value.point, 0, 0, (("frame", np.eye(4)),))
            read.add((file, value.begin))
    return copies, read


def _is_only_reached(name: str, texts: Sequence[str]) -> bool:
    """True if a variable is mentioned only in its declaration, in its assignment and in moves."""
    for text in texts:
        for word in re.finditer(rf"(?<![A-Za-z\d_]){name}(?!\w)", text, re.IGNORECASE):
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
