"""External axes (tracks, positioners, other groups) as parts of the state of a program.

A pose refers to the base of the arm, which a track moves. A pose is therefore corrected only if every external axis
moved by the texts of the program is at zero when the arm arrives. Programs that move no external axis are not affected.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

from analysis.apps.makers.program_machine import (
    EXTERNAL,
    OFF,
    Elsewhere,
    ForgetFamily,
    Move,
    Program,
    Set,
    Statement,
    Unknown,
    Value,
    family_of,
)

_AT_ZERO = 0.01
"""Largest coordinate in mm or ° of an axis at zero: its last decimal stays after a taught stop. Chosen: it changes the
angles of the arm by a few hundredths of a degree, and the correction by less than 1 µm.
"""
_AT_BEGIN = Unknown(0, 0, "these files do not define the positions of the external axes")
_ELSEWHERE = Unknown(0, 0, "a move to a place that is unknown may move the external axes")
_CHANGED = "the point is used or assigned elsewhere, possibly with different coordinates of the external axes"


@dataclass(frozen=True)
class PointAxes:
    """Coordinates of external axes at a point, None if the program may change them, and whether the point is a pose."""

    coordinates: Mapping[str, float] | None
    is_pose: bool


def is_moved(coordinate: float) -> bool:
    """Return whether the coordinate of an external axis is not zero."""
    return abs(coordinate) > _AT_ZERO


def with_external_axes(program: Program, axes: frozenset[str], point: Callable[[str], PointAxes | None]) -> Program:
    """Return the program with `axes` as parts of the state.

    point: look-up of a point by key. An axis not named by a point stays in place.
    """
    if not axes:
        return program
    parts = tuple(f"{EXTERNAL}[{axis}]" for axis in sorted(axes))

    def initial(part: str) -> Value:
        return _AT_BEGIN if family_of(part) == EXTERNAL else program.initial(part)

    def followed(statement: Statement) -> Iterator[Statement]:
        if isinstance(statement, Elsewhere):
            yield ForgetFamily(EXTERNAL, _ELSEWHERE)
        elif isinstance(statement, Move) and (of := point(statement.base or statement.key)):
            if of.coordinates is None:
                yield ForgetFamily(EXTERNAL, Unknown(statement.file, statement.line, _CHANGED))
            for axis, coordinate in (of.coordinates or {}).items():
                if axis in axes:
                    yield Set(f"{EXTERNAL}[{axis}]", "moved" if is_moved(coordinate) else OFF)
            statement = replace(statement, needs=(*statement.needs, *parts)) if of.is_pose else statement
        yield statement

    routines = {
        name: tuple(added for statement in body for added in followed(statement))
        for name, body in program.routines.items()
    }
    return replace(program, routines=routines, initial=initial)
