"""Points that a script hands to its own routines: def pick(goal): movel(goal).

A parameter is traced if its routine only moves to it, or hands it on to such a parameter. Each call with points is then
a routine of its own, which moves to these points.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace

from analysis.apps.makers.program_machine import OFF, Call, Elsewhere, Move, Statement
from analysis.apps.makers.target import ProgramTexts, UncorrectedTarget
from analysis.apps.makers.ur.poses import WORD, parameter_key
from analysis.apps.makers.ur.statements import UrStatements

NAME_OR_POSE = re.compile(r"(?<!\w)p\[(?=[^\]]*,)|[A-Za-z_]\w*")
"""A name, or the beginning of a pose, where p is no variable."""


class UrRoutines(UrStatements):
    def __init__(self, program: ProgramTexts) -> None:
        super().__init__(program)
        self._made: dict[str, tuple[Statement, ...]] = {}

    def hand(self) -> None:
        """Let the moves of each routine go to the points that its calls hand to it."""
        traced = self._traced()
        for routine, arguments in self.sites.values():
            for name, (key, at) in list(arguments.items()):
                is_literal = key.startswith("\2")
                end = self.closes[self.text.index("[", at)] + 1 if is_literal else at
                literal = self.literal(at, end) if is_literal else None
                if parameter_key(routine, name) not in traced:
                    del arguments[name]
                    if is_literal:
                        self.list_left("handed", self.text[at:end], at)
                    continue
                self.spent.add((0, at))
                if literal:
                    self.literals.add(at)
                    self.point(key, routine.name, at, literal)
                elif key in self.points.declared:
                    self.reached.add(key)
        mentions = Counter(word[0] for word in WORD.finditer(self.text))
        calls = Counter(routine.name for routine, _ in self.sites.values())
        only_with_points = {name for name, count in calls.items() if mentions[name] == count + 1}
        only_with_points -= {routine.name for routine, arguments in self.sites.values() if not arguments}
        for name in self.routines:
            if name not in only_with_points:
                self._make(name, {})
        self.routines = {name: self._made[name] for name in [*self.routines, *self._made] if name in self._made}

    def _traced(self) -> set[str]:
        """Keys of the parameters that their routines use only as targets."""
        handed = {
            place: parameter_key(routine, name)
            for routine, arguments in self.sites.values()
            for name, (_, place) in arguments.items()
        }
        uses: dict[str, list[int]] = {}
        for routine in self.all_routines:
            for word in NAME_OR_POSE.finditer(self.text, routine.begin, routine.end):
                if word[0] in routine.parameters:
                    uses.setdefault(parameter_key(routine, word[0]), []).append(word.start())
        keys = {parameter_key(routine, name) for routine in self.all_routines for name in routine.parameters}
        while True:
            kept = {
                key for key in keys if all((0, at) in self.spent or handed.get(at) in keys for at in uses.get(key, ()))
            }
            if kept == keys:
                return keys
            keys = kept

    def _make(self, name: str, points: Mapping[str, str]) -> str:
        label = f"{name}({', '.join(f'{key}: {point}' for key, point in sorted(points.items()))})" if points else name
        if label not in self._made:
            self._made[label] = ()
            self._made[label] = tuple(
                self._with_points(statement, points, label if points else "") for statement in self.routines[name]
            )
        return label

    def _with_points(self, statement: Statement, points: Mapping[str, str], label: str) -> Statement:
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
        point = points.get(of, "")
        is_joints = bool(point) and self.points.declared[point].target.joints
        if not point or (statement.base and is_joints):  # The argument is unknown.
            self.listed.add(statement.line)
            place = UncorrectedTarget(0, statement.line, of.rpartition(".")[2], "not_literal")
            if place not in self.points.left:
                self.points.left.append(place)
            return Elsewhere()
        by_angles = statement.way == "joint" and (statement.near is not None or is_joints)
        key, base = (f"{point} by {statement.key}", point) if statement.base else (point, "")
        return replace(statement, key=key, base=base, arc=arc, trusts="on" if by_angles else OFF)
