"""Points that a script hands to its own routines: def pick(goal): movel(goal).

A parameter is traced if its routine only moves to it, or hands it on to such a parameter. Each call of the routine with
points is then a routine of its own, whose moves go to these points.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace

from analysis.apps.makers.program_machine import Call, Elsewhere, Move, Statement

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


@dataclass(frozen=True)
class Argument:
    """An argument of a call: the key of a point, or of a parameter of the calling routine, at a position."""

    key: str
    place: int


@dataclass
class CallSite:
    """A call of a routine with points."""

    routine: Routine
    arguments: dict[str, Argument] = field(default_factory=dict)


def routines_in(events: Iterable[re.Match[str]], end: int) -> list[Routine]:
    """Return the routines of a text, inner routines after the outer."""
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
    """Return the key of a parameter, which no point has."""
    return f"\1{routine.name}.{name}"


def traced(routines: Iterable[Routine], sites: dict[str, CallSite], text: str, spent: set[int]) -> set[str]:
    """Return the keys of the parameters that their routines use only as targets. spent: positions of targets."""
    handed: dict[int, str] = {}
    for site in sites.values():
        for name, argument in site.arguments.items():
            handed[argument.place] = parameter_key(site.routine, name)
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
    """Replaces parameters in moves by the points of each call.

    joints: returns whether a point has joint angles. leave: is called with the moves to unknown arguments. on_way: part
    of the state for a posture kept on the way.
    """

    routines: dict[str, tuple[Statement, ...]]
    sites: dict[str, CallSite]
    joints: Callable[[str], bool]
    leave: Callable[[Move], None]
    on_way: str
    made: dict[str, tuple[Statement, ...]] = field(default_factory=dict)

    def replaced(self, only_with_points: set[str]) -> dict[str, tuple[Statement, ...]]:
        """Return the routines, those with points once for each combination. only_with_points: routines without any
        other call."""
        for name, body in self.routines.items():
            if name not in only_with_points:
                self.made[name] = self._body(body, {}, "")
        return {name: self.made[name] for name in [*self.routines, *self.made] if name in self.made}

    def _called(self, site: CallSite, points: dict[str, str]) -> str:
        mapping = {
            parameter_key(site.routine, name): points.get(argument.key, argument.key)
            for name, argument in site.arguments.items()
            if not argument.key.startswith("\1") or argument.key in points
        }
        if not mapping:
            return site.routine.name
        label = f"{site.routine.name}({', '.join(f'{key}: {point}' for key, point in sorted(mapping.items()))})"
        if label not in self.made:
            self.made[label] = ()
            self.made[label] = self._body(self.routines[site.routine.name], mapping, label)
        return label

    def _body(self, body: tuple[Statement, ...], points: dict[str, str], label: str) -> tuple[Statement, ...]:
        return tuple(self._statement(statement, points, label) for statement in body)

    def _statement(self, statement: Statement, points: dict[str, str], label: str) -> Statement:
        if isinstance(statement, Call) and (site := self.sites.get(statement.name)):
            called = self._called(site, points)
            if called == site.routine.name and called not in self.made:
                self.made[called] = ()
                self.made[called] = self._body(self.routines[called], {}, "")
            return replace(statement, name=called)
        if not isinstance(statement, Move):
            return statement
        arc = f"{statement.arc} of {label}" if statement.arc and label else statement.arc
        of = statement.base or statement.key
        if not of.startswith("\1"):
            return replace(statement, arc=arc) if arc != statement.arc else statement
        if of not in points or (statement.base and self.joints(points[of])):
            self.leave(statement)
            return Elsewhere()
        point = points[of]
        by_angles = statement.way == "joint" and (statement.near is not None or self.joints(point))
        key, base = (f"{point} by {statement.key}", point) if statement.base else (point, "")
        return replace(statement, key=key, base=base, arc=arc, trusts=None if by_angles else self.on_way)
