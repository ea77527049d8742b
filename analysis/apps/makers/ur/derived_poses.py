"""Poses that a script derives from a point: pose_trans(NAME, p[…]), pose_add(NAME, p[…]), p[NAME[0] + 0.1, NAME[1], …].

Such a pose is the point with an offset, or a point in a frame: pose_trans(plane, p[…]).
"""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from operator import add, mul, sub

import numpy as np

from analysis.apps.makers.arithmetic import Operators, tree_of, value_of
from analysis.apps.makers.numbers import frame_of
from analysis.apps.makers.points import as_value
from analysis.apps.makers.program_machine import Unknown, Value
from analysis.apps.makers.program_parser import arguments

_FUNCTION = re.compile(r"(pose_trans|pose_add)\s*\(")
_NAMED = re.compile(r"[A-Za-z_]\w*\s*=\s*(?!=)")
_WORD = re.compile(r"[A-Za-z_]\w*")
_COORDINATE = re.compile(r"([A-Za-z_]\w*)\s*\[\s*(\d)\s*\]\s*([-+][^\[\]]*)?", re.DOTALL)
PAIR = re.compile(r"pose_trans\s*\(\s*([A-Za-z_]\w*)\s*,\s*([A-Za-z_]\w*)\s*\)")
_OPERATORS: Operators = {ast.Add: add, ast.Sub: sub, ast.Mult: mul, "d2r": math.radians}
_LONGEST = 500
"""Maximum length of an expression in characters."""


@dataclass(frozen=True)
class DerivedPose:
    """A pose derived from the point at `begin` to `end` by an offset, or taken in a frame."""

    begin: int
    end: int
    offset: tuple[str, Value] | None = None
    """Unknown, with the cause, if it is computed."""
    frame: Value = ""
    """In mm, as a value of the state."""
    sources: tuple[int, ...] = ()
    """Positions of names that the expression only reads."""
    literals: tuple[int, ...] = ()
    """Positions of the numbers of offset and frame."""


@dataclass(frozen=True)
class PoseReader:
    """Parses derived poses."""

    text: str
    closes: dict[int, int]
    constants: dict[str, float]
    """Variables with a single number."""
    poses: dict[str, tuple[float, ...]]
    """Variables with a single pose."""
    is_point: Callable[[str, int], bool]
    """True if a name is a pose with numbers, or a parameter."""
    reached: frozenset[str]
    """Names that moves reach without an offset."""
    pairs: frozenset[tuple[str, str]]
    """Pairs of names in pose_trans(NAME, NAME)."""

    def derived(self, begin: int, end: int, why: Unknown) -> DerivedPose | None:
        """Derived pose from `begin` to `end`; None for other expressions. why: of a computed offset."""
        if end - begin > _LONGEST:
            return None
        if call := _FUNCTION.match(self.text, begin, end):
            if self.closes.get(call.end() - 1) != end - 1:
                return None
            places = arguments(self.text, call.end(), end - 1)
            if len(places) != 2:
                return None
            named = [_NAMED.match(self.text, *place) for place in places]
            starts = [name.end() if name else begin for name, (begin, _) in zip(named, places, strict=True)]
            first, second = ((start, stop) for start, (_, stop) in zip(starts, places, strict=True))
            return self._transformed(first, second, why) if call[1] == "pose_trans" else self._sum(first, second, why)
        return self._shifted(begin, end, why)

    def _transformed(self, first: tuple[int, int], second: tuple[int, int], why: Unknown) -> DerivedPose | None:
        name, other = self.text[slice(*first)], self.text[slice(*second)]
        frame, offset = self.values(*first), self.values(*second)
        is_literal = offset is not None and other.startswith("p")
        if frame is not None and name not in self.reached and (is_literal or self._is_frame(name, other, second[0])):
            sources, literals = self._parts(*first, True)
            value = as_value(frame_of("rotation_vector", frame))
            return DerivedPose(*second, frame=value, sources=sources, literals=literals)
        if not (_WORD.fullmatch(name) and self.is_point(name, first[0])):
            return None
        of_tool: Value = as_value(frame_of("rotation_vector", offset)) if offset else why
        sources, literals = self._parts(*second, offset is not None)
        return DerivedPose(*first, ("tool", of_tool), sources=sources, literals=literals)

    def _is_frame(self, name: str, other: str, at: int) -> bool:
        """True if pose_trans(name, other) is a point in a frame, rather than a point with an offset: the frame is the
        one that occurs with several others."""
        if not (_WORD.fullmatch(other) and self.is_point(other, at)):
            return False
        return sum(a == name for a, _ in self.pairs) >= sum(b == other for _, b in self.pairs)

    def _sum(self, first: tuple[int, int], second: tuple[int, int], why: Unknown) -> DerivedPose | None:
        name, values = self.text[slice(*first)], self.values(*second)
        if not (_WORD.fullmatch(name) and self.is_point(name, first[0])):
            return None
        is_shift = values is not None and not any(values[3:])
        value = _shift(values[:3]) if values is not None and is_shift else why
        sources, literals = self._parts(*second, values is not None)
        return DerivedPose(*first, ("frame", value), sources=sources, literals=literals)

    def _shifted(self, begin: int, end: int, why: Unknown) -> DerivedPose | None:
        if not self.text.startswith("p[", begin) or self.closes.get(begin + 1) != end - 1:
            return None
        places = arguments(self.text, begin + 2, end - 1)
        parts = [_COORDINATE.fullmatch(self.text, *place) for place in places]
        names = {part[1] for part in parts if part}
        if len(parts) != 6 or None in parts or len(names) != 1:
            return None
        coordinates = [part for part in parts if part]
        if any(int(part[2]) != k or (k > 2 and part[3]) for k, part in enumerate(coordinates)):
            return None
        name, first = coordinates[0][1], coordinates[0].start(1)
        if not self.is_point(name, first):
            return None
        numbers = [self.number(part[3] or "0") for part in coordinates[:3]]
        known = [number for number in numbers if number is not None]
        value = _shift(known) if len(known) == 3 else why
        sources = tuple(part.start(1) for part in coordinates[1:])
        return DerivedPose(first, first + len(name), ("frame", value), sources=sources)

    def _parts(self, begin: int, end: int, known: bool) -> tuple[tuple[int, ...], tuple[int, ...]]:
        if not known:
            return (), ()
        return ((begin,), ()) if _WORD.fullmatch(self.text, begin, end) else ((), (begin,))

    def values(self, begin: int, end: int) -> tuple[float, ...] | None:
        """Six numbers of a pose, in its variable or in place, with constants; None if they are not known."""
        if _WORD.fullmatch(self.text, begin, end):
            return self.poses.get(self.text[begin:end])
        if not self.text.startswith("p[", begin) or self.closes.get(begin + 1) != end - 1:
            return None
        numbers = [self.number(self.text[slice(*place)]) for place in arguments(self.text, begin + 2, end - 1)]
        known = tuple(number for number in numbers if number is not None)
        return known if len(numbers) == len(known) == 6 and np.isfinite(known).all() else None

    def number(self, text: str) -> float | None:
        """Value of sums and products of numbers and constants; None for any other text."""
        tree = tree_of(text)
        try:
            return value_of(tree, self.constants, _OPERATORS) if tree else None
        except KeyError:
            return None


def _shift(metres: tuple[float, ...] | list[float]) -> Value:
    T = np.eye(4)
    T[:3, 3] = 1e3 * np.array(metres[:3])
    return as_value(T)
