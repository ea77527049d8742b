"""Statements of URScript as statements of the state machine; `functions` has the effect of each function."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from analysis.apps.makers.numbers import frame_of
from analysis.apps.makers.points import as_value
from analysis.apps.makers.program_machine import OFF, Call, Elsewhere, End, Move, Needs, Ref, Value
from analysis.apps.makers.program_parser import NUMBER, arguments
from analysis.apps.makers.target import NamedFrame, ProgramTexts, Way
from analysis.apps.makers.ur.functions import ELSEWHERE, NOTHING, SWITCHES
from analysis.apps.makers.ur.poses import WORD, DerivedPose, Routine, UrPoses
from analysis.correction.reasons import Reason

_WAYS: dict[str, Way] = {
    "movej": "joint", "movel": "line", "movep": "line", "movec": "line", "servoj": "joint", "servoc": "line",
    "optimovej": "joint", "optimovel": "line",
}  # fmt: skip
_NEEDS: Needs = (("displaced", Ref("shift")), ("tracked", Ref("tracking")))
_MODE, _MODE_PLACE = re.compile(r"mode\s*=\s*(.*)", re.DOTALL), 5
"""The mode of movec(pose_via, pose_to, a, v, r, mode)."""
_STREAMED = ("servoj", "servoc")
"""Moves that the next statement does not wait for: the arm has not reached the target yet."""
_TARGET = re.compile(r"(?:q|pose|pose_via|pose_to|x)\s*=\s*")
_INVERSE = re.compile(r"get_inverse_kin\s*\(")
_LONGEST = 1000
_FLOW = {
    "if": "if", "switch": "switch", "while": "while", "for": "while", "break": "break", "continue": "continue",
    **dict.fromkeys(("elif", "case"), "case"), **dict.fromkeys(("else", "default"), "else"),
}  # fmt: skip
Arguments = dict[str, tuple[str, int]]
"""For each parameter of a call the key of a point, or of a parameter of the caller, and its position."""
_Arc = tuple[str, bool, bool]
"""Name of an arc, whether it rotates the tool with the tangent, and whether the target is the via point."""


class UrStatements(UrPoses):
    def __init__(self, program: ProgramTexts) -> None:
        super().__init__(program)
        self.outer: list[str] = []
        self.sites: dict[str, tuple[Routine, Arguments]] = {}
        """Calls of routines with points, by the name of the call."""
        self.tools: dict[str, int] = {}
        """Names passed to set_tcp, with a position."""
        self.reached: set[str] = set()
        self.literals: set[int] = set()
        """Poses in numbers that are points, tools, or listed."""
        self.listed: set[int] = set()
        self.derived: dict[str, DerivedPose] = {}

    def list_left(self, reason: Reason, name: str, at: int | None = None) -> None:
        self.listed.add(self.line(at))
        super().list_left(reason, name, at)

    def read(self) -> None:
        """Parse the statements in the order of execution: a call follows the evaluation of the arguments."""
        ordered = sorted(
            self.events, key=lambda event: self.closes.get(event.end() - 1, 0) if event["call"] else event.start()
        )
        self.begin_routine("")
        waiting = ""
        for event in ordered:
            self.at = event.start()
            if event["routine"]:
                if event["routine"] == "def" and not self.around:
                    self.outer.append(event["name"])
                self.open_routine(event["name"])
                if event["routine"] == "sec":
                    self.beside.append(Call(event["name"], self.why(f"{event['name']} runs beside")))
            elif event["run"]:
                self.runs_beside(event["run"])
            elif event["call"]:
                self._call(event)
            elif event["flow"]:
                waiting = self._flow(event["flow"], waiting)
            elif event["mark"] == "\n" and waiting == "return":
                self.add(End())
                waiting = ""
            elif event["mark"] == ":" and waiting != "return":
                if waiting:
                    self.blocks.after_condition(_FLOW[waiting])
                waiting = ""
        if self.around or self.blocks.open:
            self.misread("the blocks end in the wrong place", len(self.text) - 1)
        while self.around:
            self.close_routine()
        self.end_routine()

    def _flow(self, word: str, waiting: str) -> str:
        """Parse a keyword; return it if a colon or the end of the line has to complete it."""
        if waiting == "return":
            self.add(End())
        if word in _FLOW:
            self.blocks.before_condition(_FLOW[word])
        elif word == "halt":
            self.add(End(halts=True))
        elif word == "end":
            if self.blocks.open:
                self.blocks.close()
            elif self.around:
                self.close_routine()
            else:
                self.misread("the blocks end in the wrong place", self.at)
        return word if word in _FLOW or word == "return" else ""

    def _call(self, event: re.Match[str]) -> None:
        name, end = event["call"], self.closes.get(event.end() - 1)

        def places() -> list[tuple[int, int]]:
            return arguments(self.text, event.end(), end) if end else []

        if name in self.defined:
            before = self.text[self.text.rfind("\n", 0, self.at) + 1 : self.at]
            called = self._site(name, places()) if end else name
            self.blocks.evaluated(before, Call(called, self.why(f"{name} is called")))
        elif name in _WAYS:
            if end:
                self._move(name, places())
            else:
                self.leave("computed", name)
        elif name == "set_tcp":
            self.set("tool", self._tool(event.end() - 1))
        elif name in SWITCHES:
            self.set(*SWITCHES[name])
            self.add(Elsewhere())
        elif name in ELSEWHERE:
            self.add(Elsewhere())
        elif name not in NOTHING:
            self.not_known(name)
            for place in places():
                if self.literal(*place):
                    self.literals.add(place[0])
                    self.list_left("handed", self.text[slice(*place)], place[0])

    def _site(self, name: str, places: list[tuple[int, int]]) -> str:
        """Name of a call of an own routine. A call with points has its own name."""
        routine = next(one for one in self.all_routines if one.name == name)
        found: Arguments = {}
        for k, (begin, end) in enumerate(places):
            named = re.compile(r"([A-Za-z_]\w*)\s*=\s*(?!=)").match(self.text, begin, end)
            parameter = named[1] if named else routine.parameters[k] if k < len(routine.parameters) else ""
            start = named.end() if named else begin
            text = self.text[start:end]
            key = f"\2{name} at {start}" if self.literal(start, end) else self.parameter(text, start)
            key = key or (text if text in self.points.declared else "")
            if key and parameter in routine.parameters and routine.kind == "def" and len(self.named(name)) == 1:
                found[parameter] = key, start
            elif key.startswith("\2"):
                self.list_left("handed", text, start)
        if not found:
            return name
        self.sites[f"\1{name} at {self.at}"] = routine, found
        return f"\1{name} at {self.at}"

    def _move(self, name: str, places: list[tuple[int, int]]) -> None:
        named = [place for place in places if _TARGET.match(self.text, *place)]
        named.sort(key=lambda place: not self.text.startswith("pose_via", place[0]))  # The via point is passed first.
        is_arc, is_tangent = name == "movec" and len(places) > 1, False
        if is_arc:  # Mode 1, also if computed, keeps the orientation fixed to the tangent.
            texts = [self.text[slice(*place)] for place in places]
            mode = [stated[1] for text in texts if (stated := _MODE.fullmatch(text))] or texts[_MODE_PLACE:]
            is_tangent = bool(mode) and (not re.fullmatch(NUMBER, mode[0]) or float(mode[0]) != 0)
        arc = f"arc at {self.at}" if is_arc else ""
        for k, place in enumerate(named or places[: 1 + is_arc]):
            self._target(name, *place, arc=(arc, is_tangent, k == 0))
        if name in _STREAMED:
            self.add(Elsewhere())

    def _tool(self, opening: int) -> Value:
        unknown, end = self.why("set_tcp sets a computed tool"), self.closes.get(opening, 0)
        if not opening < end < opening + _LONGEST:
            return unknown
        begin, stop = arguments(self.text, opening + 1, end)[0]
        if named := re.compile(r"pose\s*=\s*").match(self.text, begin, stop):
            begin = named.end()
        name, literal = self.text[begin:stop], self.literal(begin, stop)
        values = tuple(number.value for number in literal[1]) if literal and literal[0] else self.poses.get(name)
        if values is None or not np.isfinite(values).all():
            return unknown
        if literal:
            self.literals.add(begin)
        else:
            self._use_as_numbers(name, begin)
        value = as_value(frame_of("rotation_vector", values))
        self.points.sets.append(NamedFrame("tcp", "tool", 0, self.line(), value))
        return value

    def _use_as_numbers(self, name: str, at: int) -> None:
        """Record that a variable is a tool, a frame or an offset, and no target."""
        self.spent.add((0, at))
        self.tools[name] = at
        self.points.silent.add(name)

    def _target(
        self,
        call: str,
        begin: int,
        end: int,
        near: tuple[float, ...] | None = None,
        *,
        solved: bool = False,
        arc: _Arc = ("", False, False),
    ) -> None:
        """Parse a target of a move. near (6,): joint angles in rad, if get_inverse_kin solved the pose."""
        line = self.line(begin)
        if named := _TARGET.match(self.text, begin, end):
            begin = named.end()
        inverse = None if solved or "get_inverse_kin" in self.defined else _INVERSE.match(self.text, begin, end)
        if inverse and arc[1]:
            self.leave("arc_turns", self.text[begin:end], begin)
        elif inverse:
            self._inverse(call, inverse.end(), self.closes.get(inverse.end() - 1))
        else:
            name, way, pose = self.text[begin:end], _WAYS[call], self._derived(begin, end)
            key = self._point(call, *((pose.begin, pose.end) if pose else (begin, end)))
            is_joints = key[:1] not in ("", "\1") and self.points.declared[key].target.joints
            if not key or (pose and pose.offset and is_joints):
                self.leave("not_literal" if WORD.fullmatch(name) else "computed", name, begin)
                return
            near = near if way == "joint" else None
            by_angles = way == "joint" and (near is not None or is_joints)
            # The arm keeps its configuration on a line and on a joint move to a bare pose, even on the way to a
            # waypoint with taught joint angles.
            move = Move(
                key, way, 0, line, Ref("tool"), needs=_NEEDS, trusts="on" if by_angles else OFF,
                near=near, arc=arc[0], tangent=arc[1], through=arc[2],
            )  # fmt: skip
            if pose and pose.offset:
                move = replace(move, key=f"{name} of {key}", base=key, offset=pose.offset)
            elif pose:
                move = replace(move, frame=pose.frame)
            self.add(move)

    def _derived(self, begin: int, end: int) -> DerivedPose | None:
        """Derived pose of an argument: written there, or in a variable."""
        name = self.text[begin:end]
        if pose := self.derived.get(name):
            # A parameter has its value only while its routine runs.
            of = self.parameter(self.text[pose.begin : pose.end], pose.begin)
            if of and self.routine_at(begin) != self.routine_at(pose.begin):
                return None
            self.spent.add((0, begin))
        elif not WORD.fullmatch(name):
            pose = self.derived_pose(begin, end)
        for source in pose.reads if pose else ():
            if self.text.startswith("p[", source):
                self.literals.add(source)
                continue
            self.spent.add((0, source))
            word = WORD.match(self.text, source)
            if pose and word and word[0] != self.text[pose.begin : pose.end]:  # The numbers of a frame or an offset
                self._use_as_numbers(word[0], source)
        return pose

    def _point(self, call: str, begin: int, end: int) -> str:
        name = self.text[begin:end]
        if literal := self.literal(begin, end):
            if begin not in self.literals:
                self.literals.add(begin)
                self.point(f"at {begin}", call, begin, literal)
            return f"at {begin}"
        key = self.parameter(name, begin)
        if not key and name in self.points.declared:
            key = name
            self.reached.add(name)
        if key:
            self.spent.add((0, begin))
        return key

    def _inverse(self, call: str, begin: int, end: int | None) -> None:
        """Parse get_inverse_kin(pose, qnear): a pose, with joint angles near the solution."""
        places, near = arguments(self.text, begin, end) if end else [], None
        if len(places) > 1:
            start, stop = places[1]
            if named := re.compile(r"q_?near\s*=\s*").match(self.text, start, stop):
                start = named.end()
            if literal := self.literal(start, stop):
                near = tuple(number.value for number in literal[1])
            elif near := self.joints.get(self.text[start:stop]):
                self.spent.add((0, start))
        if not places or (len(places) > 1 and near is None) or len(places) > 2:
            self.leave("computed", call, begin)
        else:
            self._target(call, *places[0], near, solved=True)
