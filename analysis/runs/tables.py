"""Measurements as the tables of docs/tables.md, the common input of evaluation, simulation and fits.

Recorded runs become tables by alignment, imported ones by reading; simulation fills the same tables. Angles are radians
and lengths mm here; in files (`analysis.runs.csv_tables`) degrees and mm.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Self, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from analysis.robot.kinematics.arm import Array, Integers
from analysis.runs.table_format import Kind, kind_named
from rigs.schema.vocabulary import CircleTest, Direction, TestName


@dataclass(frozen=True)
class Table:
    """Common part of tables: the test, and reported joints q (n, axes) rad, with a rail position as additional
    column (`rail`)."""

    if TYPE_CHECKING:

        @property
        def test(self) -> TestName: ...
        @property
        def q(self) -> Array: ...

    rail = False

    @property
    def kind(self) -> Kind[Self]:
        """Kind of test, which provides all test-dependent functions."""
        return cast("Kind[Self]", kind_named(self.test))

    @property
    def rows(self) -> Integers:
        """File row (n,) of each reading, or the first of several averaged ones."""
        row: Integers | None = getattr(self, "row", None)
        return np.arange(1, len(self.q) + 1) if row is None else row


@dataclass(frozen=True)
class CircleTable(Table):
    """One circle driven in one direction, including recorded lead-in and lead-out.

    t_s (n,); q (n, 6) rad as reported; g_mm (n, 2) of g1 and g2; u_t_s (n,): individual standard uncertainty of each
    row's time, None if unknown.
    """

    test: CircleTest
    direction: Direction
    t_s: Array
    q: Array
    g_mm: Array
    u_t_s: Array | None = None


@dataclass(frozen=True)
class RadialTable(Table):
    """Readings at targets of a hemisphere, in order of time.

    target, orientation (n,): from 1; polar, azimuth (n,) rad; q (n, 6) rad; g_mm (n,): |B - TCP| less the link's
    nominal length; t_s (n,), zeros if the table has no time.
    """

    test: ClassVar[TestName] = "radial"
    target: Integers
    polar: Array
    azimuth: Array
    orientation: Integers
    t_s: Array
    q: Array
    g_mm: Array


@dataclass(frozen=True)
class RepeatabilityTable(Table):
    """Readings at targets approached from outside (`out`), from inside (`in`) or from elsewhere (`none`).

    target, round (n,): from 1; approach (n,) of str; q (n, 6) rad; g_mm (n,); t_s (n,) as in a radial table.
    """

    test: ClassVar[TestName] = "repeatability"
    target: Integers
    approach: NDArray[np.str_]
    round: Integers
    t_s: Array
    q: Array
    g_mm: Array


@dataclass(frozen=True)
class PoseTable(Table):
    """Tool poses measured by a tracker, in the tracker's frame.

    q (n, axes) rad, with a rail position in m as additional column (`rail`); xyz_mm (n, 3); rpy (n, 3) rad, fixed-axis
    roll-pitch-yaw, or None if only positions were measured; row (n,): from 1, file row of each, or the first of
    several; None for 1 … n; came_from (n, axes) rad: joint angles before the last move, which determine the side of
    backlash, or None if the robot came from the previous pose.
    """

    test: ClassVar[TestName] = "pose"
    q: Array
    xyz_mm: Array
    rpy: Array | None
    row: Integers | None = None
    rail: bool = False
    came_from: Array | None = None


@dataclass(frozen=True)
class TouchTable(Table):
    """Touches: the tool's ball seated in fixed sockets, in successive postures.

    socket (n,) of str; q (n, axes) rad, with a rail as for poses; came_from (n, axes) rad and row (n,) as for poses.
    """

    test: ClassVar[TestName] = "touch"
    socket: NDArray[np.str_]
    q: Array
    came_from: Array | None = None
    row: Integers | None = None
    rail: bool = False

    @property
    def xyz_mm(self) -> Array:
        """Ball position relative to its socket (n, 3) mm: zero."""
        return np.zeros((len(self.q), 3))


P = TypeVar("P", bound="PoseTable | TouchTable")


def last_moves(table: PoseTable | TouchTable) -> Array | None:
    """Return the rotation of each joint (n, axes) rad in the last move; None if the rows do not state it."""
    return None if table.came_from is None else table.q - table.came_from


def counted_back(table: P, turns_rad: Array) -> P:
    """Return the table with joints counted back by full turns (n, axes) rad."""
    came_from = None if table.came_from is None else table.came_from - turns_rad
    return replace(table, q=table.q - turns_rad, came_from=came_from)


@dataclass(frozen=True)
class PathTable(Table):
    """Tracker recording along paths: t_s (n,); xyz_mm (n, 3) in the tracker's frame."""

    test: ClassVar[TestName] = "path"
    t_s: Array
    xyz_mm: Array

    @property
    def q(self) -> Array:
        """Empty joints (n, 0): a tracker reads none, and its clock is not the robot's."""
        return np.empty((len(self.t_s), 0))


def content_order(table: Table) -> Integers:
    """Return the rows (n,) of a table sorted by what they say. Equal tables in another order of rows are sorted alike,
    so that sums, random draws, neighbourhoods and ties do not depend on that order."""
    columns = [values.reshape(len(values), -1).T for name, values in vars(table).items() if _is_content(name, values)]
    keys = [column for of_field in reversed(columns) for column in of_field[::-1]]
    return np.asarray(np.lexsort(keys), dtype=np.int64)


def _is_content(name: str, values: object) -> bool:
    return name != "row" and isinstance(values, np.ndarray)


def in_content_order(table: P) -> P:
    """Return a table of places sorted by `content_order`; each row keeps its number in the file."""
    order = content_order(table)
    columns = {name: values[order] for name, values in vars(table).items() if _is_content(name, values)}
    return replace(table, **columns, row=table.rows[order])


TargetTable = RadialTable | RepeatabilityTable
"""Tables of one gauge at targets of a hemisphere."""
GaugeTable = CircleTable | TargetTable
"""Tables of gauge readings with times."""
PlaceTable = PoseTable | TouchTable
"""Tables of positions, three coordinates per row, each with a posture."""
Evidence = GaugeTable | PlaceTable
"""Tables with joint angles, usable for a diagnosis of the arm."""
