"""Points that a script hands to its own routines: def pick(goal): movel(goal).

A parameter is traced if its routine only moves to it, or hands it on to such a parameter. Each call of the routine with
points is then a routine of its own, whose moves go to these points.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace

from analysis.apps.makers.program_machine import OFF, Call, Elsewhere, Move, Statement

NAME_OR_POSE = re.compile(r"(?<!\w)p\[(?=[^\]]*,)|[A-Za-z_]\w*")
"""A name, or the beginning of a pose, which is not the variable p."""
_OPENS = frozenset(("if", "while", "for", "switch"))


@dataclass(frozen=True)
class Routine:
    """A routine of the script, from `begin` to `end` of its text."""

    kind: str
    name: str
    parameters: tuple[str, ...]
    begin: int
    end: int


Arguments = dict[str, tuple[str, int]]
"""For each parameter of a call the key of a point, or of a parameter of the calling routine, and its position."""
CallSites = dict[str, tuple[Routine, Arguments]]
"""Calls of routines with points, by the name of the call."""


def routines_in(events: Iterable[re.Match[str]], end: int) -> list[Routine]:
    """Routines of a text, inner routines after the outer."""
    open_at: list[tuple[re.Match[str], bool]] = []
    found: list[Routine] = []
    for event in events:
        if event["routine"] or event["flow"] in _OPENS:
            open_at.append((event, bool(event["routine"])))
        elif event["flow"] == "end" and open_at:
            begin, is_routine = open_at.pop()
            if is_routine:
                found.append(_routine(begin, event.start()))
    found += [_routine(begin, end) for begin, is_routine in open_at if is_routine]
    return sorted(found, key=lambda routine: routine.begin)


def _routine(event: re.Match[str], end: int) -> Routine:
    inside = (event["parameters"] or "").strip("()")
    names = tuple(part.partition("=")[0].strip() for part in inside.split(",") if part.strip())
    return Routine(event["routine"], event["name"], names, event.end(), end)


def parameter_key(routine: Routine, name: str) -> str:
    """Key of a parameter, which no point has."""
    return f"\1{routine.name}.{name}"


def traced(routines: Iterable[Routine], sites: CallSites, text: str, spent: set[int]) -> set[str]:
    """Keys of the parameters that their routines use only as targets. spent: positions of targets."""
    handed: dict[int, str] = {}
    for routine, arguments in sites.values():
        for name, (_, place) in arguments.items():
            handed[place] = parameter_key(routine, name)
    uses: dict[str, list[int]] = {}
    for routine in routines:
        for word in NAME_OR_POSE.finditer(text, routine.begin, routine.end):
            if word[0] in routine.parameters:
                uses.setdefault(parameter_key(routine, word[0]), []).append(word.start())
    keys = {parameter_key(routine, name) for routine in routines for name in routine.parameters}
    while True:
        kept = {key for key in keys if all(at in spent or handed.get(at) in keys for at in uses.get(key, ()))}
        if kept == keys:
            return keys
        keys = kept


@dataclass
class HandedPoints:
    """Replaces parameters in moves by the points of each call."""

    routines: dict[str, tuple[Statement, ...]]
    sites: CallSites
    joints: Callable[[str], bool]
    """True if a point has joint angles."""
    leave: Callable[[Move], None]
    """Called with the moves to unknown arguments."""
    made: dict[str, tuple[Statement, ...]] = field(default_factory=dict)

    def replaced(self, only_with_points: set[str]) -> dict[str, tuple[Statement, ...]]:
        """Repeat the routines with points for each combination. only_with_points: routines without any other call."""
        for name in self.routines:
            if name not in only_with_points:
                self._make(name, {})
        return {name: self.made[name] for name in [*self.routines, *self.made] if name in self.made}

    def _make(self, name: str, points: dict[str, str]) -> str:
        """Add a routine with points for its parameters, and return its name."""
        label = f"{name}({', '.join(f'{key}: {point}' for key, point in sorted(points.items()))})" if points else name
        if label not in self.made:
            self.made[label] = ()
            self.made[label] = tuple(
                self._statement(statement, points, label if points else "") for statement in self.routines[name]
            )
        return label

    def _statement(self, statement: Statement, points: dict[str, str], label: str) -> Statement:
        if isinstance(statement, Call) and statement.name in self.sites:
            routine, arguments = self.sites[statement.name]
            handed = {
                parameter_key(routine, name): points.get(key, key)
                for name, (key, _) in arguments.items()
                if not key.startswith("\1") or key in points
            }
            return replace(statement, name=self._make(routine.name, handed))
        if not isinstance(statement, Move):
            return statement
        arc = f"{statement.arc} of {label}" if statement.arc and label else statement.arc
        of = statement.base or statement.key
        if not of.startswith("\1"):
            return replace(statement, arc=arc)
        if of not in points or (statement.base and self.joints(points[of])):
            self.leave(statement)
            return Elsewhere()
        point = points[of]
        by_angles = statement.way == "joint" and (statement.near is not None or self.joints(point))
        key, base = (f"{point} by {statement.key}", point) if statement.base else (point, "")
        return replace(statement, key=key, base=base, arc=arc, trusts="on" if by_angles else OFF)
