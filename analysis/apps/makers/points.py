"""The points of a program with the moves that use them, and the reasons for leaving points uncorrected.

A point is corrected only if every move to it has the same tool and frame on every path, no other setting displaces it,
nothing else refers to it and, for a pose, every external axis moved by the program is at zero.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Literal, cast

import numpy as np

from analysis.apps.makers.program_machine import (
    BEGIN,
    EXTERNAL,
    OFF,
    Elsewhere,
    ForgetAll,
    ForgetFamily,
    Move,
    Needs,
    Program,
    Ref,
    Set,
    Statement,
    Unknown,
    Usage,
    Value,
    family_of,
    programs_of,
    reachable,
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

_AT_ZERO = 0.01
"""Coordinate in mm or ° of an external axis at zero: its last decimal stays after a taught stop. Chosen: it changes the
correction by less than 1 µm."""
Place = tuple[float, ...] | Unknown
"""The 16 numbers of a frame in mm, or unknown."""
_Because = tuple[Reason, tuple[Unknown, ...]]
"""A reason with the places that cause it."""


@dataclass
class Point:
    """A declared point; one with a reason cannot be corrected."""

    target: Target
    reason: Reason | None
    changed: Unknown | None = None
    usages: list[Usage] = field(default_factory=list)


@dataclass
class Points:
    files: int
    """Number of texts to correct; the others are only read."""
    declared: dict[str, Point] = field(default_factory=dict)
    silent: set[str] = field(default_factory=set)
    """Keys of points that are not listed if unused."""
    axes: set[str] = field(default_factory=set)
    """External axes moved by the texts."""
    notices: list[Notice] = field(default_factory=list)
    left: list[UncorrectedTarget] = field(default_factory=list)
    sets: list[NamedFrame] = field(default_factory=list)
    uses_alone: Callable[[], dict[str, list[Usage]]] = dict
    """Uses of each point without concurrent code; empty if there is none."""

    def declare(self, key: str, target: Target, reason: Reason | None = None) -> None:
        """Add a point. A second one under the same key makes its meaning uncertain."""
        if key not in self.declared:
            self.declared[key] = Point(target, reason)
            return
        self.change(key, target.file, target.line)
        if target.file < self.files and key not in self.silent:
            self.left.append(UncorrectedTarget(target.file, target.line, target.name, "changed"))

    def change(self, key: str, file: int, line: int) -> None:
        """Record that the program uses a point in a statement other than a move."""
        point = self.declared[key]
        point.changed = point.changed or Unknown(file, line, "the point is used or assigned there")

    def parsed(self, program: Program, foot: Place | None = None) -> Parsed:
        """The targets, and the moves that a program can make to them.

        foot: foot of the robot in the world, if the program states frames in the world.
        """
        program = _with_external_axes(program, sorted(self.axes), self.declared)
        usages = _in_base(usages_of(program), foot)
        for key, of_point in self._by_point(usages).items():
            self.declared[key].usages = of_point
        alone = replace(program, beside=(), broken=())
        self.uses_alone = cache(lambda: {} if alone == program else self._by_point(_in_base(usages_of(alone), foot)))
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
        first = [name for name, body in program.routines.items() if any(isinstance(of, Move) for of in body)]
        if targets:  # Relative moves in routines that run, directly or indirectly, with a routine that has targets
            bodies = (of for name in reachable(program.routines, first) for of in program.routines[name])
            relative = {of.relative for of in bodies if isinstance(of, Elsewhere) and of.relative}
            skipped += [UncorrectedTarget(at.file, at.line, at.why, "relative") for at in sorted(relative)]
        ordered = tuple(sorted(skipped, key=lambda move: (move.file, move.line)))
        named: set[tuple[str, str]] = {(of.kind, of.name.lower()) for of in self.sets}
        users: list[Usage | Target] = [*usages, *(point.target for point in self.declared.values())]
        for one in users:
            for kind, name in (("tool", one.tool), ("frame", one.frame)):
                named |= {(kind, name.lower())} if isinstance(name, str) and name else set()
        sets, notices = tuple(self.sets), tuple(self.notices)
        missing = _missing(program, first)
        return Parsed(tuple(targets), steps, ordered, tuple(next_to_left), sets, notices, frozenset(named), missing)

    def _by_point(self, usages: Iterable[Usage]) -> dict[str, list[Usage]]:
        found: dict[str, list[Usage]] = {}
        for usage in usages:
            if (key := usage.move.base or usage.move.key) in self.declared:
                found.setdefault(key, []).append(usage)
        return found

    def _reason(self, key: str, point: Point) -> _Because | None:
        """The reason for leaving a point, if any: the one that would remain without the concurrent code."""
        why = next(_reasons(point), None)
        if why and why[0] == "not_understood" and (usages := self.uses_alone().get(key)):
            others = _reasons(replace(point, usages=usages))
            why = next((other for other in others if other[0] != "not_understood"), why)
        return why

    def _targets(self) -> tuple[list[Target], dict[str, int], list[UncorrectedTarget]]:
        """Targets, their indices by the key of a move, and what is left."""
        targets: list[Target] = []
        places: dict[str, int] = {}
        skipped = list(self.left)
        for key, point in self.declared.items():
            if why := self._reason(key, point):
                # The numbers of a point in another file stay, but the arm stands there.
                if point.target.file < self.files and (why[0] != "unused" or key not in self.silent):
                    skipped.append(UncorrectedTarget(point.target.file, point.target.line, point.target.name, *why))
                continue
            bad_offsets = {usage.move.key: (usage.move, why) for usage, why in _bad_offsets(point)}
            name = point.target.name
            skipped += [UncorrectedTarget(at.file, at.line, name, "offset", (why,)) for at, why in bad_offsets.values()]
            first = point.usages[0]
            target = replace(
                point.target,
                tool=_named_or_frame(first.tool, point.target.tool),
                frame=_named_or_frame(first.frame, point.target.frame),
                near=next((usage.move.near for usage in point.usages if usage.move.near), None),
                unknown_offsets=bool(bad_offsets),
                flags=point.target.flags if any(usage.trusts != OFF for usage in point.usages) else None,
            )
            places[key] = base = len(targets)
            targets.append(target)
            for move_key, (move, offset) in {u.move.key: (u.move, u.offset) for u in point.usages if u.offset}.items():
                if move_key in bad_offsets or offset is None:
                    continue
                places[move_key] = len(targets)
                kind, numbers = offset
                assert isinstance(numbers, tuple)  # noqa: S101 - the others are unknown
                offset_frame = kind, as_frame(numbers)
                targets.append(replace(target, line=move.line, file=move.file, offset=offset_frame, of=base))
            self.sets += [named for usage in point.usages for named in _registers(usage)]
        return targets, places, skipped


def _in_base(usages: Sequence[Usage], foot: Place | None) -> Sequence[Usage]:
    """Uses with frames in the base of the robot, which has its foot at a known place in the world."""
    return usages if foot is None else [replace(usage, frame=frame_in_base(usage.frame, foot)) for usage in usages]


def frame_in_base(value: Value, foot: Place) -> Value:
    """A frame in the world, or the world "0" itself, in the base of the robot. Frames that users state by name are in
    the base already."""
    if isinstance(value, Unknown) or (isinstance(value, str) and value != "0"):
        return value
    if isinstance(foot, Unknown):
        return foot
    frame = np.eye(4) if isinstance(value, str) else as_frame(value)
    return as_value(np.linalg.inv(as_frame(foot)) @ frame)


def is_moved(coordinate: float) -> bool:
    return abs(coordinate) > _AT_ZERO


def _with_external_axes(program: Program, axes: Sequence[str], points: Mapping[str, Point]) -> Program:
    """Add the positions of external axes to the state. An axis that a point does not name stays in place."""
    if not axes:
        return program
    at_zero: Needs = tuple(("external_axes", Ref(f"{EXTERNAL}[{axis}]")) for axis in axes)
    at_begin = Unknown(0, 0, "these files do not define the positions of the external axes")
    elsewhere = Unknown(0, 0, "a move to a place that is unknown may move the external axes")
    changed = "the point is used or assigned elsewhere, possibly with different coordinates of the external axes"

    def initial(variable: str) -> Value:
        return at_begin if family_of(variable) == EXTERNAL else program.initial(variable)

    def followed(statement: Statement) -> Iterator[Statement]:
        if isinstance(statement, Elsewhere):
            yield ForgetFamily(EXTERNAL, elsewhere)
        elif isinstance(statement, Move) and (point := points.get(statement.base or statement.key)):
            if point.changed:
                yield ForgetFamily(EXTERNAL, Unknown(statement.file, statement.line, changed))
            for axis, coordinate in () if point.changed else point.target.external:
                if axis in axes:
                    yield Set(f"{EXTERNAL}[{axis}]", "moved" if is_moved(coordinate) else OFF)
            if not point.target.joints:
                statement = replace(statement, needs=(*statement.needs, *at_zero))
        yield statement

    routines = {
        name: tuple(added for statement in body for added in followed(statement))
        for name, body in program.routines.items()
    }
    return replace(program, routines=routines, initial=initial)


def _sources(usage: Usage, places: dict[str, int]) -> frozenset[int | None]:
    return frozenset(AT_BEGIN if key == BEGIN else places.get(key or "") for key in usage.comes_from)


def _arcs(usages: Sequence[Usage], places: dict[str, int]) -> dict[str, Arc]:
    """Arcs with orientations other than written, by name."""
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
    kinds: dict[str, Literal["tool", "frame"]] = {"UTOOL": "tool", "UFRAME": "frame"}
    for of, value in ((usage.move.tool, usage.tool), (usage.move.frame, usage.frame)):
        if isinstance(of, Ref) and isinstance(value, tuple):
            family, _, number = of.variable.partition("[")
            if family in kinds:
                yield NamedFrame(number.rstrip("]"), kinds[family], usage.move.file, usage.move.line, value)


def _reasons(point: Point) -> Iterator[_Because]:
    """Yield the reasons for leaving a point uncorrected, the strongest first."""
    target, usages = point.target, point.usages
    shared = point.reason == "shared_variable"
    if point.reason and not shared and (usages or point.reason != "unused"):
        yield point.reason, ()
    if point.changed:
        yield "changed", (point.changed,)
    if not usages:
        yield "unused", ()
    yield from _displacements(point)
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
    if shared:  # The reason that remains if the directory is given comes first.
        yield "shared_variable", ()


def _displacements(point: Point) -> Iterator[_Because]:
    """Yield the reasons why moves to a point end elsewhere.

    If a move reaches the point itself, unknown offsets of others do not matter.
    """
    if all(usage.offset for usage in point.usages):
        for _, why in _bad_offsets(point):
            yield "offset", (why,)
    for usage in point.usages:
        move = _unknown_at(usage, "the move")
        for reason, value in usage.needs:
            if isinstance(value, Unknown):
                yield "not_understood" if value.everything else reason, (value, move)
            elif value != OFF:
                yield reason, (move,)


def _bad_offsets(point: Point) -> Iterator[tuple[Usage, Unknown]]:
    """Yield the moves whose offset is unknown or differs between paths, each with the cause."""
    offsets: dict[str, object] = {}
    for usage in point.usages:
        if offsets.setdefault(usage.move.key, usage.offset) != usage.offset:
            yield usage, _unknown_at(usage, "the offset differs between the paths leading here")
        elif usage.offset and point.target.joints:
            yield usage, _unknown_at(usage, "an offset from joint angles")
        elif usage.offset and not isinstance(value := usage.offset[1], tuple):
            yield usage, value if isinstance(value, Unknown) else _unknown_at(usage, "the move with the offset")


def _unknown_at(usage: Usage, fact: str) -> Unknown:
    return Unknown(usage.move.file, usage.move.line, fact)


def _named_or_frame(value: Value, of_point: Array | str) -> Array | str:
    if value == "" or isinstance(value, Unknown):
        return of_point
    return value if isinstance(value, str) else as_frame(value)


def as_frame(numbers: Iterable[float]) -> Array:
    return np.array(tuple(numbers), dtype=float).reshape(4, 4)


def as_value(T: Array) -> tuple[float, ...]:
    return tuple(np.asarray(T, dtype=float).ravel().tolist())


def _missing(program: Program, names: Iterable[str]) -> tuple[str, ...]:
    """Unknown routines and instructions in the programs to which the named routines belong."""
    programs = programs_of(program.routines, [call.name for call in program.beside])
    starts = {start for name in names for start in programs[name]}
    bodies = (of for name in reachable(program.routines, starts) for of in program.routines[name])
    return tuple(sorted({of.missing for of in bodies if isinstance(of, ForgetAll) and of.missing}))
