"""The points of a program with the moves that use them, and the reasons for leaving points uncorrected.

A point with a name is a single target, however often it is used. It is corrected only if every move to it has the same
tool and frame on every path, no other setting displaces it, and nothing else in the program refers to it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, cast

import numpy as np

from analysis.apps.makers.external_axes import PointAxes, with_external_axes
from analysis.apps.makers.program_machine import (
    BEGIN,
    EXTERNAL,
    OFF,
    Call,
    Elsewhere,
    Move,
    Program,
    Ref,
    Unknown,
    Usage,
    Value,
    family_of,
    usages_of,
)
from analysis.apps.makers.target import (
    AT_BEGIN,
    Arc,
    NamedFrame,
    Notice,
    Parsed,
    Target,
    TargetMove,
    UncorrectedTarget,
    Way,
)
from analysis.correction.reasons import Reason
from analysis.robot.kinematics.arm import Array

_BY_PART: dict[str, Reason] = {
    "shift": "displaced",
    "tracking": "tracked",
    "external_tcp": "external_tcp",
    "coordinated": "coordinated",
    "switch": "switched",
    "selected": "selected",
    "option": "not_understood",
    EXTERNAL: "external_axes",
}
"""Reason for leaving a point uncorrected if this part of the state is not certainly off."""


@dataclass
class _Point:
    """A declared point."""

    target: Target
    reason: Reason | None
    changed: Unknown | None = None
    usages: list[Usage] = field(default_factory=list)


@dataclass
class Points:
    """The points of a program during parsing, and the moves to unknown points.

    files: number of texts to correct; the others are in the same directory. silent: keys of points that are not listed
    if unused. axes: external axes moved by the texts.
    """

    files: int
    silent: set[str] = field(default_factory=set)
    axes: set[str] = field(default_factory=set)
    notices: list[Notice] = field(default_factory=list)
    _points: dict[str, _Point] = field(default_factory=dict)
    _left: list[UncorrectedTarget] = field(default_factory=list)
    _sets: list[NamedFrame] = field(default_factory=list)

    def declare(self, key: str, target: Target, reason: Reason | None = None) -> None:
        """Add a point. A point with a reason is a valid target of moves but cannot be corrected."""
        if key in self._points:
            self.change(key, target.file, target.line)
            if target.file < self.files and key not in self.silent:
                self.leave(UncorrectedTarget(target.file, target.line, target.name, "changed"))
        else:
            self._points[key] = _Point(target, reason)

    def knows(self, key: str) -> bool:
        """Return whether a point with this key exists."""
        return key in self._points

    def all_keys(self) -> Iterable[str]:
        """Return the keys of the points."""
        return self._points.keys()

    def target(self, key: str) -> Target:
        """Return an existing point."""
        return self._points[key].target

    def change(self, key: str, file: int, line: int) -> None:
        """Record that the program uses a point in a statement other than a move."""
        point = self._points[key]
        point.changed = point.changed or Unknown(file, line, "the point is used or assigned there")

    def leave(self, move: UncorrectedTarget) -> None:
        """List a move that cannot be corrected."""
        self._left.append(move)

    def state(self, named: NamedFrame) -> None:
        """Add the numbers that the program assigns to a tool or frame."""
        self._sets.append(named)

    def parsed(self, program: Program) -> Parsed:
        """Return the targets with the moves that a program can make to them."""
        usages = usages_of(with_external_axes(program, frozenset(self.axes), self._axes_of))
        for usage in usages:
            if point := self._points.get(usage.move.base or usage.move.key):
                point.usages.append(usage)
        targets, places, skipped = self._targets()
        arcs = _arcs(usages, places)
        steps = tuple(
            TargetMove(
                places[usage.move.key],
                _sources(usage, places),
                cast("Way", usage.move.way),
                usage.trusts == "on",
                arcs.get(usage.move.arc),
            )
            for usage in usages
            if usage.move.key in places
        )
        next_to_left: list[int] = []  # The corrected targets of moves between a corrected and an uncorrected point
        for usage in usages:
            key = usage.move.key
            for source in usage.comes_from:
                if source not in (None, BEGIN) and (key in places) != (source in places):
                    next_to_left.append(places[key if key in places else source])
        if targets:
            skipped += [UncorrectedTarget(at.file, at.line, at.why, "relative") for at in _relative_moves(program)]
        ordered = tuple(sorted(skipped, key=lambda move: (move.file, move.line)))
        notices, named = tuple(self.notices), self._names_in_use(usages)
        return Parsed(tuple(targets), steps, ordered, tuple(next_to_left), tuple(self._sets), notices, named)

    def _names_in_use(self, usages: Sequence[Usage]) -> frozenset[tuple[str, str]]:
        """Return the names of the tools and frames in moves, points and settings of the program."""
        named: set[tuple[str, str]] = {(of.kind, of.name.lower()) for of in self._sets}
        for usage in usages:
            named |= {(kind, value.lower()) for kind, value in _by_kind(usage.tool, usage.frame) if value}
        for point in self._points.values():
            of_point = _by_kind(point.target.tool, point.target.frame)
            named |= {(kind, value.lower()) for kind, value in of_point if value}
        return frozenset(named)

    def _axes_of(self, key: str) -> PointAxes | None:
        """Return the external axes of a point, None if there is no such point."""
        point = self._points.get(key)
        if point is None:
            return None
        return PointAxes(None if point.changed else dict(point.target.external), not point.target.joints)

    def _targets(self) -> tuple[list[Target], dict[str, int], list[UncorrectedTarget]]:
        """Return the targets of the points, their indices, and the uncorrected points and moves.

        Targets have the tool and the frame of their moves. The keys of the indices are those of the moves.
        """
        targets: list[Target] = []
        places: dict[str, int] = {}
        skipped = list(self._left)
        for key, point in self._points.items():
            is_foreign = point.target.file >= self.files  # Its numbers stay, but the arm stands there.
            if why := next(_reasons(point), None):
                if not is_foreign and (why[0] != "unused" or key not in self.silent):
                    skipped.append(UncorrectedTarget(point.target.file, point.target.line, point.target.name, *why))
                continue
            skipped += _unknown_offsets(point)
            first = point.usages[0]
            target = replace(
                point.target,
                tool=_tool(first.tool, point.target.tool),
                frame=_tool(first.frame, point.target.frame),
                near=next((usage.move.near for usage in point.usages if usage.move.near), None),
                unknown_offsets=next(_bad_offsets(point), None) is not None,
                flags=point.target.flags if any(usage.trusts != OFF for usage in point.usages) else None,
            )
            places[key] = base = len(targets)
            targets.append(target)
            unknown = {usage.move.key for usage, _ in _bad_offsets(point)}
            for usage in {usage.move.key: usage for usage in point.usages if usage.offset}.values():
                if usage.move.key in unknown or usage.offset is None:
                    continue
                places[usage.move.key] = len(targets)
                kind, numbers = usage.offset
                assert isinstance(numbers, tuple)  # noqa: S101 - the others are unknown
                offset = kind, as_frame(numbers)
                targets.append(replace(target, line=usage.move.line, file=usage.move.file, offset=offset, of=base))
            self._sets += [named for usage in point.usages for named in _registers(usage)]
        return targets, places, skipped


def _relative_moves(program: Program) -> list[Unknown]:
    """Return the relative moves in routines that are called, directly or indirectly, by routines with targets."""
    calls = {
        name: {statement.name for statement in body if isinstance(statement, Call)} & program.routines.keys()
        for name, body in program.routines.items()
    }
    todo = [name for name, body in program.routines.items() if any(isinstance(statement, Move) for statement in body)]
    reached: set[str] = set()
    while todo:
        name = todo.pop()
        if name not in reached:
            reached.add(name)
            todo += calls[name]
    moves = (statement for name in reached for statement in program.routines[name])
    return sorted({move.relative for move in moves if isinstance(move, Elsewhere) and move.relative})


def _by_kind(tool: object, frame: object) -> Iterator[tuple[str, str]]:
    """Yield a tool and a frame, if they are given by name."""
    yield from ((kind, value) for kind, value in (("tool", tool), ("frame", frame)) if isinstance(value, str))


def _sources(usage: Usage, places: dict[str, int]) -> frozenset[int | None]:
    """Return the indices of the targets at the start of a move."""
    return frozenset(AT_BEGIN if key == BEGIN else places.get(key or "") for key in usage.comes_from)


def _arcs(usages: Sequence[Usage], places: dict[str, int]) -> dict[str, Arc]:
    """Return the arcs with orientations other than written, by name."""
    arcs: dict[str, Arc] = {}
    for usage in usages:
        if not (name := usage.move.arc):
            continue
        arc, place = arcs.get(name, Arc(frozenset(), None, None, usage.move.tangent)), places.get(usage.move.key)
        if usage.move.through:
            arcs[name] = replace(arc, starts=arc.starts | _sources(usage, places), through=place)
        else:
            arcs[name] = replace(arc, end=place)
    return arcs


def _registers(usage: Usage) -> Iterator[NamedFrame]:
    """Yield the tool and frame of a move if the program itself sets their numbers in a register."""
    kinds: dict[str, Literal["tool", "frame"]] = {"UTOOL": "tool", "UFRAME": "frame"}
    for of, value in ((usage.move.tool, usage.tool), (usage.move.frame, usage.frame)):
        if isinstance(of, Ref) and isinstance(value, tuple):
            family, _, number = of.part.partition("[")
            if family in kinds:
                yield NamedFrame(number.rstrip("]"), kinds[family], usage.move.file, usage.move.line, value)


def _reasons(point: _Point) -> Iterator[tuple[Reason, tuple[Unknown, ...]]]:
    """Yield the reasons for leaving a point uncorrected, each with the places causing it."""
    target, usages = point.target, point.usages
    if point.reason and (usages or point.reason != "unused"):
        yield point.reason, ()
    if point.changed:
        yield "changed", (point.changed,)
    if not usages:
        yield "unused", ()
    yield from _elsewhere(point)
    for usage in () if target.joints else usages:
        move = _unknown_at(usage, "the move")
        of_parts: tuple[tuple[Value, Reason], ...] = ((usage.tool, "unknown_tool"), (usage.frame, "unknown_frame"))
        for value, reason in of_parts:
            if isinstance(value, Unknown):
                yield "not_understood" if value.everything else reason, (value, move)
        if (usage.tool, usage.frame) != (usages[0].tool, usages[0].frame):
            yield "several_frames", (_unknown_at(usages[0], "one move"), move)
    by_angles = [usage for usage in usages if usage.move.near]
    for usage in by_angles:
        if usage.move.near != by_angles[0].move.near:
            yield "two_postures", (_unknown_at(by_angles[0], "one move"), _unknown_at(usage, "another move"))


def _bad_offsets(point: _Point) -> Iterator[tuple[Usage, Unknown]]:
    """Yield the moves whose offset from a point is unknown or differs between paths, each with the cause."""
    offsets: dict[str, object] = {}
    for usage in point.usages:
        if offsets.setdefault(usage.move.key, usage.offset) != usage.offset:
            yield usage, _unknown_at(usage, "the offset differs between the paths leading here")
        elif usage.offset and point.target.joints:
            yield usage, _unknown_at(usage, "an offset from joint angles")
        elif usage.offset and not isinstance(value := usage.offset[1], tuple):
            yield usage, value if isinstance(value, Unknown) else _unknown_at(usage, "the move with the offset")


def _unknown_offsets(point: _Point) -> Iterator[UncorrectedTarget]:
    """Yield the moves of a corrected point that reach an unknown position: the error there is unknown."""
    for usage, why in {usage.move.key: (usage, why) for usage, why in _bad_offsets(point)}.values():
        yield UncorrectedTarget(usage.move.file, usage.move.line, point.target.name, "offset", (why,))


def _elsewhere(point: _Point) -> Iterator[tuple[Reason, tuple[Unknown, ...]]]:
    """Yield the reasons why moves to a point do not end at the point itself, or have an unknown or varying offset.

    The work point comes first: if a move reaches it without an offset, unknown offsets of others do not matter.
    """
    usages = point.usages
    if all(usage.offset for usage in usages):
        for _, why in _bad_offsets(point):
            yield "offset", (why,)
    for usage in usages:
        for part, value in usage.needs:
            reason, move = _BY_PART[family_of(part.partition(" ")[0])], _unknown_at(usage, "the move")
            if isinstance(value, Unknown):
                yield "not_understood" if value.everything else reason, (value, move)
            elif value != OFF:
                yield reason, (move,)


def _unknown_at(usage: Usage, fact: str) -> Unknown:
    return Unknown(usage.move.file, usage.move.line, fact)


def _tool(value: Value, of_point: Array | str) -> Array | str:
    if value == "" or isinstance(value, Unknown):
        return of_point
    return value if isinstance(value, str) else as_frame(value)


def as_frame(numbers: Iterable[float]) -> Array:
    """Return the frame (4, 4) in mm of a value of the state machine."""
    return np.array(tuple(numbers), dtype=float).reshape(4, 4)


def as_value(T: Array) -> tuple[float, ...]:
    """Return a frame (4, 4) in mm as a value of the state machine."""
    return tuple(np.asarray(T, dtype=float).ravel().tolist())
