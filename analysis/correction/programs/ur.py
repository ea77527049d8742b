"""Targets in URScript: joint lists in rad and poses p[x, y, z, rx, ry, rz] in m and rad, in moves or in variables.

Source: Universal Robots, Script Manual. A pose counts in the base; movel and movec keep the posture in which the arm
stands, get_inverse_kin takes the solution closest to qnear. PolyScope writes for a waypoint NAME a pose NAME_p and the
taught joint angles NAME_q (scripts of PolyScope 5 in public repositories).
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

import numpy as np

from analysis.correction.programs.numbers import Decimals, frame_of
from analysis.correction.programs.target import (
    Form,
    Gathered,
    Left,
    Lines,
    Number,
    Parsed,
    Reason,
    Target,
    Way,
    arguments,
    blanked,
    brackets,
    lines_of,
    numbers_in,
)
from analysis.kinematics.arm import Array

DECIMALS = Decimals(place=(8, 10), turn=(8, 10))
"""1e-8 m is 0.01 µm; PolyScope writes twelve decimals and more."""
_BLANK = re.compile(r"#[^\n]*|\"[^\"\n]*\"|'[^'\n]*'|^[ \t]*\$[^\n]*", re.MULTILINE)
_EVENT = re.compile(
    r"^[ \t]*(?:global[ \t]+|local[ \t]+)?(?P<name>[A-Za-z_]\w*)[ \t]*=[ \t]*"
    r"(?P<kind>p?)\[(?P<list>[^\[\]\n]*)\][ \t]*\r?$"
    r"|\b(?P<flow>def|end|if|elif|else|while|for|thread|return|break|continue|halt|run|join|kill|sec)\b"
    r"|\b(?P<call>[A-Za-z_]\w*)[ \t]*\(",
    re.MULTILINE,
)
_WAYS: dict[str, Way] = {
    "movej": "joint", "movel": "line", "movep": "line", "movec": "line",
    "servoj": "joint", "servoc": "line",
}  # fmt: skip
_STANDS = re.compile(
    r"set_\w+|get_\w+|write_\w+|read_\w+|is_\w+|sleep|popup|textmsg|sync|norm|to_str|str_\w+|d2r|r2d|request_\w+|"
    r"pose_\w+|interpolate_pose|wrench_trans|point_dist|stopj|stopl|modbus_\w+|socket_\w+|rpc_factory|enter_critical|"
    r"and|or|not|abs|sqrt|sin|cos|ceil|floor"
)
"""Functions after which the arm stands where it stood, as far as a posture goes."""
_INVERSE = re.compile(r"get_inverse_kin\s*\(")
_WORD = re.compile(r"[A-Za-z_]\w*")
_LONGEST = 1000
"""Characters of a literal tool, more than seven numbers have."""


@dataclass
class _Reader:
    text: str
    lines: Lines
    closes: dict[int, int]
    gathered: Gathered = field(default_factory=Gathered)
    joints: dict[str, tuple[float, ...]] = field(default_factory=dict)
    spent: set[int] = field(default_factory=set)
    """Where names of points stand as targets or are declared."""
    tool: Array | str = "tcp"

    def left(self, place: int, reason: Reason, name: str) -> Left:
        return Left(0, self.lines.at(place), name[:60], reason)


def parse(texts: tuple[str, ...]) -> Parsed:
    """Return the targets of a script."""
    text = blanked(texts[0], _BLANK)
    reader = _Reader(text, lines_of(text), brackets(text))
    events = list(_EVENT.finditer(text))
    for event in events:
        if event["name"]:
            _declare(reader, event)
    only = _only_tool(reader, events)
    at = 0
    for event in events:
        if event.start() < at:
            continue
        if event["flow"]:
            reader.gathered.stop()
            reader.tool = "tcp"
        elif event["call"]:
            if only is not None:
                reader.tool = only
            at = _call(reader, event)
    for word in _WORD.finditer(text):
        if reader.gathered.knows(word[0]) and word.start() not in reader.spent:
            reader.gathered.change(word[0])
    return reader.gathered.parsed(silent=frozenset(reader.joints))


def _declare(reader: _Reader, event: re.Match[str]) -> None:
    numbers = numbers_in(reader.text, event.start("list"), event.end("list"))
    name = event["name"]
    reader.spent.add(event.start("name"))
    if numbers is None or len(numbers) != 6:
        if reader.gathered.knows(name):
            reader.gathered.change(name)
        return
    pose = event["kind"] == "p"
    if not pose:
        reader.joints[name] = tuple(one.value for one in numbers)
    line = reader.lines.at(event.start("name"))
    target = Target(name, 0, line, "rotation_vector" if pose else "joints_rad", numbers, "tcp", "base")
    reader.gathered.declare(name, target)


def _only_tool(reader: _Reader, events: list[re.Match[str]]) -> Array | None:
    """Return the tool (4, 4) that every set_tcp of a script sets, if there is just one."""
    found = {_literal_tool(reader, event.end() - 1) for event in events if event["call"] == "set_tcp"}
    (values,) = found if len(found) == 1 else (None,)
    return None if values is None else frame_of("rotation_vector", values)


def _literal_tool(reader: _Reader, opening: int) -> tuple[float, ...] | None:
    end = reader.closes.get(opening, 0)
    first = arguments(reader.text, opening + 1, end)[0] if opening < end < opening + _LONGEST else (0, 0)
    values = _list(reader.text, *first)
    return None if values is None or values[0] != "p" else tuple(one.value for one in values[1])


def _list(text: str, begin: int, end: int) -> tuple[str, tuple[Number, ...]] | None:
    """Return "p" or "" and the six numbers of a literal, or None."""
    found = re.compile(r"(p?)\[([^\[\]]*)\]").fullmatch(text, begin, end)
    numbers = numbers_in(text, found.start(2), found.end(2)) if found else None
    return (found[1], numbers) if found and numbers and len(numbers) == 6 else None


def _call(reader: _Reader, event: re.Match[str]) -> int:
    """Take a call and return where reading goes on."""
    name, text = event["call"], reader.text
    if name == "set_tcp":
        values = _literal_tool(reader, event.end() - 1)
        reader.tool = f"tcp of line {reader.lines.at(event.start())}" if values is None else _tool(values)
    if name not in _WAYS:
        if not _STANDS.fullmatch(name):
            reader.gathered.stop()
        return event.end()
    end = reader.closes.get(event.end() - 1)
    if end is None:
        reader.gathered.leave(reader.left(event.start(), "computed", name))
        return event.end()
    places = arguments(text, event.end(), end)
    for place in places[: 2 if name in ("movec", "servoc") and len(places) > 1 else 1]:
        _target(reader, name, *place)
    return end


def _tool(values: tuple[float, ...]) -> Array:
    return frame_of("rotation_vector", values) if np.isfinite(values).all() else np.eye(4)


def _target(
    reader: _Reader, call: str, begin: int, end: int, near: tuple[float, ...] | None = None, *, solved: bool = False
) -> None:
    """Take a target of a move; `solved` if it stands in get_inverse_kin, with the joint angles `near` (6,) rad."""
    text = reader.text
    if named := re.compile(r"(?:q|pose|pose_via|pose_to|q_near)\s*=\s*").match(text, begin, end):
        begin = named.end()
    if not solved and (inverse := _INVERSE.match(text, begin, end)):
        _inverse(reader, call, inverse.end(), reader.closes.get(inverse.end() - 1))
        return
    name = text[begin:end]
    way = "joint" if near is not None else _WAYS[call]
    if literal := _list(text, begin, end):
        name = f"{call} at {begin}"
        form: Form = "rotation_vector" if literal[0] else "joints_rad"
        target = Target(call, 0, reader.lines.at(begin), form, literal[1], reader.tool, "base")
        reader.gathered.declare(name, target)
    elif reader.gathered.knows(name):
        reader.spent.add(begin)
        if near is None and name.endswith("_p"):
            near = reader.joints.get(f"{name[:-2]}_q")
    reason: Reason = "not_literal" if _WORD.fullmatch(name) else "computed"
    left = reader.left(begin, reason, name)
    reader.gathered.move(name, way, left, tool=reader.tool, near=near)


def _inverse(reader: _Reader, call: str, begin: int, end: int | None) -> None:
    """Take get_inverse_kin(pose, qnear): a pose with the joint angles beside which its solution lies."""
    places = arguments(reader.text, begin, end) if end else []
    near = None
    if len(places) > 1:
        start, stop = places[1]
        if named := re.compile(r"q_?near\s*=\s*").match(reader.text, start, stop):
            start = named.end()
        literal = _list(reader.text, start, stop)
        near = tuple(one.value for one in literal[1]) if literal else reader.joints.get(reader.text[start:stop])
        if near is not None and not literal:
            reader.spent.add(start)
    if not places or (len(places) > 1 and near is None) or len(places) > 2:
        reader.gathered.leave(reader.left(begin, "computed", call))
        return
    _target(reader, call, *places[0], near, solved=True)
