"""Literals and parameters of a script, and the poses that it derives from a point: the point with an offset,
pose_trans(NAME, p[…]), pose_add(NAME, p[…]), p[NAME[0] + 0.1, NAME[1], …], or in a frame, pose_trans(plane, p[…]).
"""

from __future__ import annotations

import ast
import math
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from operator import add, mul, sub

import numpy as np

from analysis.apps.makers.arithmetic import Operators, tree_of, value_of
from analysis.apps.makers.numbers import frame_of
from analysis.apps.makers.points import as_value
from analysis.apps.makers.program_machine import Call, Value
from analysis.apps.makers.program_parser import NUMBER, ProgramParser, arguments, brackets, numbers_in
from analysis.apps.makers.target import Form, Number, ProgramTexts, Target

_QUOTED = re.compile(r"\"[^\"\n]*\"|'[^'\n]*'")
_BLANK = re.compile(rf"#[^\n]*|{_QUOTED.pattern}|^[ \t]*\$[^\n]*", re.MULTILINE)
_EVENT = re.compile(
    r"\b(?P<routine>def|thread|sec)[ \t]+(?P<name>[A-Za-z_]\w*)[ \t]*(?P<parameters>\([^()\n]*\))?[ \t]*:"
    r"|\brun[ \t]+(?P<run>[A-Za-z_]\w*)"
    r"|(?<![\w.])(?P<flow>(?:end|if|elif|else|while|return|break|continue|halt)(?!\w)"
    r"|(?:for|switch|case|default)\b(?=[^\n=]*:[ \t]*$))"
    r"|(?<![\w.])(?P<call>[A-Za-z_]\w*)[ \t]*\("
    r"|(?P<mark>[:\n])"
)
_WRITTEN = re.compile(r"(?<![\w.])([A-Za-z_]\w*)\s*(?:\[[^\[\]\n]*\]\s*|\.\w+\s*)*=(?!=)")
_NUMBER_DECLARED = re.compile(
    rf"^[ \t]*(?:global[ \t]+|local[ \t]+)?([A-Za-z_]\w*)[ \t]*=[ \t]*({NUMBER})[ \t]*$", re.MULTILINE
)
_REACHED = re.compile(
    r"\b(?:movej|movel|movep|movec|servoj|servoc|optimovej|optimovel|get_inverse_kin)\s*\(\s*"
    r"(?:\w+\s*=\s*)?([A-Za-z_]\w*)\s*[,)]"
)
_PAIR = re.compile(r"pose_trans\s*\(\s*([A-Za-z_]\w*)\s*,\s*([A-Za-z_]\w*)\s*\)")
_FUNCTION = re.compile(r"(pose_trans|pose_add)\s*\(")
_NAMED = re.compile(r"[A-Za-z_]\w*\s*=\s*(?!=)")
WORD = re.compile(r"[A-Za-z_]\w*")
_COORDINATE = re.compile(r"([A-Za-z_]\w*)\s*\[\s*(\d)\s*\]\s*([-+][^\[\]]*)?", re.DOTALL)
_OPERATORS: Operators = {ast.Add: add, ast.Sub: sub, ast.Mult: mul, "d2r": math.radians}
_LONGEST = 500
_OPENS = frozenset(("if", "while", "for", "switch"))
_Place = tuple[int, int]


@dataclass(frozen=True)
class Routine:
    kind: str
    name: str
    parameters: tuple[str, ...]
    begin: int
    end: int


@dataclass(frozen=True)
class DerivedPose:
    """A pose derived from the point at `begin` to `end`."""

    begin: int
    end: int
    offset: tuple[str, Value] | None = None
    """Unknown, with the cause, if it is computed."""
    frame: Value = ""
    reads: tuple[int, ...] = ()
    """Positions of names and of numbers that the expression only reads."""


class UrPoses(ProgramParser):
    """A script during parsing. Positions identify what begins there."""

    def __init__(self, program: ProgramTexts) -> None:
        super().__init__(program, _BLANK)
        if odd := re.search("[\"']", _QUOTED.sub(lambda quoted: " " * len(quoted[0]), self.texts[0])):
            self.misread("a string does not end in its line", odd.start())
        self.closes = brackets(self.texts[0])
        self.text = text = _in_one_line(self.texts[0], self.closes)
        self.texts = (text,)
        self.events = list(_EVENT.finditer(text))
        for event in self.events:
            if event["routine"]:
                self.defined.setdefault(event["name"], []).append(event["name"])
        self.all_routines = _routines_in(self.events, len(text))
        self.joints: dict[str, tuple[float, ...]] = {}
        self.poses: dict[str, tuple[float, ...]] = {}
        """Variables with a single list of joint angles, or a single pose."""
        assignments = (assignment for assignment in _WRITTEN.finditer(text))
        named = (one[1] for one in assignments if text[: one.start()].rstrip()[-1:] not in ("(", ","))
        parameters = (name for event in self.events for name in WORD.findall(event["parameters"] or ""))
        self.written = Counter([*named, *parameters])
        once = [found for found in _NUMBER_DECLARED.finditer(text) if self.written[found[1]] == 1]
        self._numbers = {found[1]: float(found[2]) for found in once}
        self._reached = frozenset(_REACHED.findall(text))
        self._pairs: frozenset[tuple[str, str]] = frozenset(_PAIR.findall(text))

    def misread(self, fault: str, at: int) -> None:
        self.beside.append(Call("\0", self.why(fault, at)))

    def scopes(self, name: str) -> tuple[str, ...]:
        return (name,)

    def routine_at(self, at: int) -> Routine | None:
        return next((one for one in reversed(self.all_routines) if one.begin <= at < one.end), None)

    def parameter(self, name: str, at: int) -> str:
        """Key of the parameter with this name at a position, or an empty string."""
        routine = self.routine_at(at)
        is_parameter = routine and name in routine.parameters and len(self.named(routine.name)) == 1
        return parameter_key(routine, name) if routine and is_parameter else ""

    def literal(self, begin: int, end: int) -> tuple[str, tuple[Number, ...]] | None:
        """ "p" or "", and the six numbers of a literal; None for any other text."""
        literal = re.compile(r"(p?)\[([^\[\]]*)\]").fullmatch(self.text, begin, end)
        numbers = numbers_in(self.text, *literal.span(2)) if literal else None
        return (literal[1], numbers) if literal and numbers and len(numbers) == 6 else None

    def point(self, key: str, name: str, at: int, literal: tuple[str, tuple[Number, ...]]) -> None:
        form: Form = "rotation_vector" if literal[0] else "joints_rad"
        self.points.declare(key, Target(name, 0, self.line(at), form, literal[1], "tcp", "base"))

    def derived_pose(self, begin: int, end: int) -> DerivedPose | None:
        """Parse an expression; None if it is no derived pose."""
        if end - begin > _LONGEST:
            return None
        call = _FUNCTION.match(self.text, begin, end)
        if call is None:
            return self._shifted(begin, end)
        places = arguments(self.text, call.end(), end - 1)
        if self.closes.get(call.end() - 1) != end - 1 or len(places) != 2:
            return None
        named = [_NAMED.match(self.text, *place) for place in places]
        starts = [name.end() if name else start for name, (start, _) in zip(named, places, strict=True)]
        first, second = ((start, stop) for start, (_, stop) in zip(starts, places, strict=True))
        values, is_sum = self._values(*second), call[1] == "pose_add"
        if not is_sum and (frame := self._frame(first, second, values)):
            return DerivedPose(*second, frame=as_value(frame_of("rotation_vector", frame)), reads=first[:1])
        if not self._is_point(*first):
            return None
        value: Value = self.why("the offset is computed", first[0])
        if values and not is_sum:
            value = as_value(frame_of("rotation_vector", values))
        elif values and not any(values[3:]):
            value = _shift(values[:3])
        return DerivedPose(*first, ("frame" if is_sum else "tool", value), reads=second[:1] if values else ())

    def _frame(self, first: _Place, second: _Place, values: tuple[float, ...] | None) -> tuple[float, ...] | None:
        """Numbers of the frame if pose_trans(first, second) is a point in a frame, which occurs with several points."""
        name, other = self.text[slice(*first)], self.text[slice(*second)]
        is_point = bool(values) and other.startswith("p")
        if not is_point and self._is_point(*second):
            is_point = sum(a == name for a, _ in self._pairs) >= sum(b == other for _, b in self._pairs)
        return self._values(*first) if is_point and name not in self._reached else None

    def _is_point(self, begin: int, end: int) -> bool:
        """True if a text is the name of a pose with numbers, or of a parameter."""
        name = self.text[begin:end]
        return bool(WORD.fullmatch(name)) and (name in self.poses or bool(self.parameter(name, begin)))

    def _shifted(self, begin: int, end: int) -> DerivedPose | None:
        parts = [_COORDINATE.fullmatch(self.text, *place) for place in self._inside(begin, end)]
        coordinates = [part for part in parts if part]
        if len(parts) != 6 or len(coordinates) != 6 or len({part[1] for part in coordinates}) != 1:
            return None
        if any(int(part[2]) != k or (k > 2 and part[3]) for k, part in enumerate(coordinates)):
            return None
        place = coordinates[0].span(1)
        if not self._is_point(*place):
            return None
        known = [number for part in coordinates[:3] if (number := self._number(part[3] or "0")) is not None]
        value = _shift(known) if len(known) == 3 else self.why("the offset is computed", begin)
        return DerivedPose(*place, ("frame", value), reads=tuple(part.start(1) for part in coordinates[1:]))

    def _inside(self, begin: int, end: int) -> list[_Place]:
        """Ranges of the coordinates of p[…]; none for other text."""
        is_pose = self.text.startswith("p[", begin) and self.closes.get(begin + 1) == end - 1
        return arguments(self.text, begin + 2, end - 1) if is_pose else []

    def _values(self, begin: int, end: int) -> tuple[float, ...] | None:
        """Six numbers of a pose, by variable or in place; None if they are not known."""
        if WORD.fullmatch(self.text, begin, end):
            return self.poses.get(self.text[begin:end])
        numbers = [self._number(self.text[slice(*place)]) for place in self._inside(begin, end)]
        known = tuple(number for number in numbers if number is not None)
        return known if len(numbers) == len(known) == 6 and np.isfinite(known).all() else None

    def _number(self, text: str) -> float | None:
        """Value of sums and products of numbers and constants; None for any other text."""
        tree = tree_of(text)
        try:
            return value_of(tree, self._numbers, _OPERATORS) if tree else None
        except KeyError:
            return None


def _shift(metres: Sequence[float]) -> Value:
    T = np.eye(4)
    T[:3, 3] = 1e3 * np.array(metres)
    return as_value(T)


def _in_one_line(text: str, closes: dict[int, int]) -> str:
    parts, at = [], 0
    for opening in sorted(closes):
        if opening >= at:
            parts += [text[at:opening], text[opening : closes[opening]].replace("\n", " ")]
            at = closes[opening]
    return "".join((*parts, text[at:]))


def _routines_in(events: Iterable[re.Match[str]], end: int) -> list[Routine]:
    """Routines of a text, inner routines after the outer."""
    open_at: list[re.Match[str]] = []
    ends: list[tuple[re.Match[str], int]] = []
    for event in events:
        if event["routine"] or event["flow"] in _OPENS:
            open_at.append(event)
        elif event["flow"] == "end" and open_at:
            ends.append((open_at.pop(), event.start()))
    found = []
    for event, stop in (*ends, *((event, end) for event in open_at)):
        parts = (event["parameters"] or "").strip("()").split(",")
        names = tuple(part.partition("=")[0].strip() for part in parts if part.strip())
        if event["routine"]:
            found.append(Routine(event["routine"], event["name"], names, event.end(), stop))
    return sorted(found, key=lambda routine: routine.begin)


def parameter_key(routine: Routine, name: str) -> str:
    """Key of a parameter, different from that of any point."""
    return f"\1{routine.name}.{name}"
