"""Reader of targets in URScript: joint lists in rad, and poses p[x, y, z, rx, ry, rz] in m and rad.

Targets are in moves or in variables. Source: Universal Robots, Script Manual (e-Series, 5.x). Poses refer to the base.
movel and movec keep the current posture of the arm, and get_inverse_kin selects the solution closest to qnear. For a
waypoint NAME, PolyScope writes a pose NAME_p and the taught joint angles NAME_q, which serve only as qnear of a joint
move (scripts of PolyScope 5 in public repositories). A script is a single file.
"""

from __future__ import annotations

import re
from collections import Counter

from analysis.apps.makers.numbers import Decimals
from analysis.apps.makers.program_machine import OFF, Move, Value
from analysis.apps.makers.program_parser import numbers_in
from analysis.apps.makers.program_reader import ProgramReader, Remark
from analysis.apps.makers.target import Notice, Parsed, ProgramTexts, UncorrectedTarget
from analysis.apps.makers.ur.functions import NO_TARGETS, NOTHING, OF_LISTS
from analysis.apps.makers.ur.handed_points import NAME_OR_POSE, HandedPoints, parameter_key, traced
from analysis.apps.makers.ur.statements import WORD, UrStatements

_DECIMALS = Decimals(place=(8, 10), turn=(8, 10))
"""Decimals of corrected numbers: 1e-8 m is 0.01 µm. PolyScope writes at least twelve decimals."""
_DECLARED = re.compile(
    r"^[ \t]*(?:global[ \t]+|local[ \t]+)?(?P<name>[A-Za-z_]\w*)[ \t]*=[ \t]*(?P<kind>p?)\[(?P<list>[^\[\]\n]*)\]"
    r"[ \t]*$",
    re.MULTILINE,
)
_DERIVED = re.compile(
    r"^[ \t]*(?P<scope>global[ \t]+|local[ \t]+)?(?P<name>[A-Za-z_]\w*)[ \t]*=[ \t]*"
    r"(?P<pose>(?:pose_trans|pose_add)[ \t]*\(|p\[)",
    re.MULTILINE,
)
_POSE = re.compile(r"(?<!\w)p\[([^\[\]]*)\]")
_PART_DECLARED = re.compile(
    r"(?<![\w.])(?P<name>[A-Za-z_]\w*(?:\.\w+|\[[^\[\]\n]*\])+)[ \t]*=[ \t]*p?\[(?P<list>[^\[\]]*)\]"
)
"""Numbers assigned to a part of a struct or of a list."""
_METHOD = re.compile(r"(?<![\w.])([A-Za-z_]\w*)[ \t]*\.[ \t]*([A-Za-z_]\w*)[ \t]*\(")


class _UrReader(UrStatements):
    """The points: variables with numbers, what calls hand to routines, and what is used otherwise."""

    def declare(self) -> None:
        """Add the variables assigned with lists of six numbers. Only variables without other assignments are literals.

        Numbers assigned to parts of structs and lists are listed: moves to them are computed.
        """
        for declared in _DECLARED.finditer(self.text):
            name, is_pose = declared["name"], declared["kind"] == "p"
            if (literal := self.literal(declared.start("kind"), declared.end("list") + 1)) is None:
                continue
            self.spent.add((0, declared.start("name")))
            if self.written[name] == 1:
                (self.poses if is_pose else self.joints)[name] = tuple(number.value for number in literal[1])
            self.points.silent.update(() if is_pose else (name,))
            self.literals.add(declared.start("list") - 2)
            self.point(name, name, declared.start("name"), literal)
        for found in _DERIVED.finditer(self.text):
            begin, end = found.start("pose"), self.closes.get(found.end() - 1, -1) + 1
            rest = self.text[end : self.text.find("\n", end) if "\n" in self.text[end:] else None]
            if self.written[found["name"]] != 1 or rest.strip():
                continue
            pose = self.pose_reader.derived(begin, end, self.why("the offset is computed", begin))
            of_parameter = pose and self.parameter(self.text[pose.begin : pose.end], pose.begin)
            if pose and not (of_parameter and (found["scope"] or "").startswith("global")):
                self.derived[found["name"]] = pose
                self.spent.add((0, found.start("name")))
        for part in _PART_DECLARED.finditer(self.text):
            numbers = numbers_in(self.text, *part.span("list"))
            if numbers and len(numbers) == 6:
                self.list_left("not_literal", part["name"], part.start())

    def notice_other_programs(self) -> None:
        """Note each function of another program called through a handle, such as rpc_factory."""
        names = {f"{call[1]}.{call[2]}": call for call in reversed([*_METHOD.finditer(self.text)])}
        for name, call in sorted(names.items(), key=lambda item: item[1].start()):
            if call[2] not in OF_LISTS:
                fact = f"{name} belongs to a different program: rig assumes that it neither moves the robot nor sets a"
                self.points.notices.append(Notice(0, self.line(call.start()), f"{fact} tool"))

    def hand(self) -> None:
        """Let the moves of each routine go to the points that its calls hand to it."""
        keys = traced(self.all_routines, self.sites, self.text, {at for _, at in self.spent})
        mentions = Counter(word[0] for word in WORD.finditer(self.text))
        calls = Counter(routine.name for routine, _ in self.sites.values())
        for routine, arguments in self.sites.values():
            for name, (key, at) in list(arguments.items()):
                is_literal = key.startswith("\2")
                end = self.closes[self.text.index("[", at)] + 1 if is_literal else at
                literal = self.literal(at, end) if is_literal else None
                if parameter_key(routine, name) not in keys:
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
        only = {name for name, count in calls.items() if mentions[name] == count + 1}
        plain = {routine.name for routine, arguments in self.sites.values() if not arguments}
        seen: set[tuple[int, str]] = set()

        def leave(move: Move) -> None:
            name = (move.base or move.key).rpartition(".")[2]
            if (move.line, name) not in seen:
                seen.add((move.line, name))
                self.listed.add(move.line)
                self.points.left.append(UncorrectedTarget(0, move.line, name, "not_literal"))

        def joints(key: str) -> bool:
            return self.points.declared[key].target.joints

        self.routines = HandedPoints(self.routines, self.sites, joints, leave).replaced(only - plain)

    def watch_points(self) -> None:
        """Mark the points that are tools as well, or that the script computes with."""
        for name in self.tools.keys() & self.reached:
            self.change(name, self.tools[name])
        for word in self.mentions(NAME_OR_POSE):
            pose = None if word[0] in self.points.declared else self.derived.get(word[0])
            self.change(self.text[pose.begin : pose.end] if pose else word[0])

    def list_other_poses(self) -> None:
        """List the poses in numbers that are neither points nor tools, frames and offsets."""
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
