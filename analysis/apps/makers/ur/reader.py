"""Reader of targets in URScript: joint lists in rad, and poses p[x, y, z, rx, ry, rz] in m and rad.

Source: Universal Robots, Script Manual (e-Series, 5.x). Poses refer to the base. movel and movec keep the posture of
the arm, and get_inverse_kin selects the solution closest to qnear. For a waypoint NAME, PolyScope writes a pose NAME_p
and the taught joint angles NAME_q, used only as qnear of a joint move (public scripts of PolyScope 5).

A routine may move to points that its calls hand to it: def pick(goal): movel(goal). A parameter is traced if its
routine only moves to it, or hands it on to such a parameter. Each call with points is then a routine of its own.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace

from analysis.apps.makers.numbers import Decimals
from analysis.apps.makers.program_machine import OFF, Call, Elsewhere, Move, Statement, Value
from analysis.apps.makers.program_parser import numbers_in
from analysis.apps.makers.program_reader import ProgramReader, Remark
from analysis.apps.makers.target import Notice, Parsed, ProgramTexts, UncorrectedTarget
from analysis.apps.makers.ur.functions import NO_TARGETS, NOTHING, OF_LISTS
from analysis.apps.makers.ur.poses import WORD, parameter_key
from analysis.apps.makers.ur.statements import UrStatements

_DECIMALS = Decimals(place=(8, 10), turn=(8, 10))
"""1e-8 m is 0.01 µm. PolyScope writes at least twelve decimals."""
_ASSIGNED = re.compile(
    r"^[ \t]*(?P<scope>global[ \t]+|local[ \t]+)?(?P<name>[A-Za-z_]\w*)[ \t]*=[ \t]*(?P<value>[p\[][^\n]*)",
    re.MULTILINE,
)
_POSE = re.compile(r"(?<!\w)p\[([^\[\]]*)\]")
_PART_DECLARED = re.compile(
    r"(?<![\w.])(?P<name>[A-Za-z_]\w*(?:\.\w+|\[[^\[\]\n]*\])+)[ \t]*=[ \t]*p?\[(?P<list>[^\[\]]*)\]"
)
"""Numbers assigned to a part of a struct or of a list."""
_METHOD = re.compile(r"(?<![\w.])([A-Za-z_]\w*)[ \t]*\.[ \t]*([A-Za-z_]\w*)[ \t]*\(")
_NAME_OR_POSE = re.compile(r"(?<!\w)p\[(?=[^\]]*,)|[A-Za-z_]\w*")
"""A name, or the beginning of a pose, where p is no variable."""


class _UrReader(UrStatements):
    """The points of a script, and the variables used otherwise."""

    def __init__(self, program: ProgramTexts) -> None:
        super().__init__(program)
        self._made: dict[str, tuple[Statement, ...]] = {}
        """The routines, with points for their parameters."""

    def declare(self) -> None:
        """Add the variables assigned with six numbers or a derived pose; list numbers in parts of structs and lists."""
        assignments = list(_ASSIGNED.finditer(self.text))
        for assigned in assignments:
            name, begin = assigned["name"], assigned.start("value")
            if literal := self.literal(begin, begin + len(assigned["value"].rstrip())):
                self.spent.add((0, assigned.start("name")))
                if self.written[name] == 1:
                    (self.poses if literal[0] else self.joints)[name] = tuple(number.value for number in literal[1])
                self.points.silent.update(() if literal[0] else (name,))
                self.literals.add(begin)
                self.point(name, name, assigned.start("name"), literal)
        for assigned in assignments:
            begin, is_single = assigned.start("value"), self.written[assigned["name"]] == 1
            pose = self.derived_pose(begin, begin + len(assigned["value"].rstrip())) if is_single else None
            of_parameter = pose and self.parameter(self.text[pose.begin : pose.end], pose.begin)
            if pose and not (of_parameter and (assigned["scope"] or "").startswith("global")):
                self.derived[assigned["name"]] = pose
                self.spent.add((0, assigned.start("name")))
        for part in _PART_DECLARED.finditer(self.text):
            numbers = numbers_in(self.text, *part.span("list"))
            if numbers and len(numbers) == 6:
                self.list_left("not_literal", part["name"], part.start())

    def notice_other_programs(self) -> None:
        names = {f"{call[1]}.{call[2]}": call for call in reversed([*_METHOD.finditer(self.text)])}
        for name, call in sorted(names.items(), key=lambda item: item[1].start()):
            if call[2] not in OF_LISTS:
                fact = f"{name} belongs to a different program: rig assumes that it neither moves the robot nor sets a"
                self.points.notices.append(Notice(0, self.line(call.start()), f"{fact} tool"))

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
            for word in _NAME_OR_POSE.finditer(self.text, routine.begin, routine.end):
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

    def watch_points(self) -> None:
        """Mark the points that are also tools, or that the script computes with."""
        for name in self.tools.keys() & self.reached:
            self.change(name, self.tools[name])
        for word in self.mentions(_NAME_OR_POSE):
            pose = None if word[0] in self.points.declared else self.derived.get(word[0])
            self.change(self.text[pose.begin : pose.end] if pose else word[0])

    def list_other_poses(self) -> None:
        """List the poses in numbers that have no known use."""
        calls = [
            (call["call"], call.end(), end)
            for call in self.events
            if call["call"] and (end := self.closes.get(call.end() - 1))
        ]
        for pose in _POSE.finditer(self.text):
            at, literal = pose.start(), self.literal(*pose.span())
            if not literal or at in self.literals or self.line(at) in self.listed:
                continue
            around = [name for name, begin, end in calls if begin <= at < end]
            if NO_TARGETS.isdisjoint(around):
                is_handed = any(name in self.defined or name not in NOTHING for name in around)
                is_listed = any(self.text[k] == "[" and k < at < end for k, end in self.closes.items())
                self.list_left("handed" if is_handed else "array" if is_listed else "computed", pose[0], at)

    def initial(self, variable: str) -> Value:
        return "tcp" if variable == "tool" else OFF


def parse(program: ProgramTexts) -> Parsed:
    reader = _UrReader(program)
    reader.declare()
    reader.notice_other_programs()
    reader.read()
    reader.hand()
    reader.watch_points()
    reader.list_other_poses()
    # A script starts with the statements outside all routines or, if there are none, with the only outer routine.
    starts = "" if reader.routines[""] else reader.outer[0] if len(reader.outer) == 1 else None
    return reader.points.parsed(reader.program(kept=("tool",), starts=starts))


READER = ProgramReader(parse, _DECIMALS, Remark("# "), null_frames=("base",))
