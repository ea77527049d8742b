"""Tables of docs/tables.md in memory: the common input of evaluation, simulation and fits.

Recorded runs are aligned to tables, and imported ones are read from files. Simulations produce the same tables. Angles
are in rad and lengths in mm, but files contain degrees and mm (`analysis.runs.csv_tables`).
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
    """Common part of all tables: the test, and reported joint angles q (n, axes) rad. `rail`: q has an additional
    column with the rail position in m.
    """

    if TYPE_CHECKING:

        @property
        def test(self) -> TestName: ...
        @property
        def q(self) -> Array: ...

    rail = False

    @property
    def kind(self) -> Kind[Self]:
        """Kind of the test, which implements all functions that depend on it."""
        return cast("Kind[Self]", kind_named(self.test))

    @property
    def rows(self) -> Integers:
        """Row number (n,) in the file of each reading, or of the first averaged reading."""
        row: Integers | None = getattr(self, "row", None)
        return np.arange(1, len(self.q) + 1) if row is None else row


@dataclass(frozen=True)
class CircleTable(Table):
    """A circle driven in one direction, including the recorded lead-in and lead-out.

    t_s (n,) s; q (n, 6) rad as reported; g_mm (n, 2): readings of g1 and g2; u_t_s (n,): individual standard
    uncertainty of the times, None if unknown.
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

    target, orientation (n,): numbers from 1. polar, azimuth (n,) rad. q (n, 6) rad.
    g_mm (n,): |B - TCP| minus the nominal length of the link.
    t_s (n,) s: zeros if the table has no times.
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
    """Readings at targets approached from outside (`out`), from inside (`in`), or in another way (`none`).

    target, round (n,): numbers from 1. approach (n,) of str. q (n, 6) rad. g_mm (n,). t_s (n,) s as in a radial table.
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

    q (n, axes) rad: joint angles; `rail`: with an additional column for the rail position in m.
    xyz_mm (n, 3): positions.
    rpy (n, 3) rad: fixed-axis roll-pitch-yaw angles, None if only positions were measured.
    row (n,): row number in the file of each reading, or of the first averaged reading. None means 1 … n.
    came_from (n, axes) rad: joint angles before the last move, which determine the side of the backlash. None if each
    pose was reached from the previous one.
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
    """Touches: the ball on the tool is seated in fixed sockets, in successive postures.

    socket (n,) of str. q (n, axes) rad, with a rail as for poses. came_from (n, axes) rad and row (n,) as for poses.
    """

    test: ClassVar[TestName] = "touch"
    socket: NDArray[np.str_]
    q: Array
    came_from: Array | None = None
    row: Integers | None = None
    rail: bool = False

    @property
    def xyz_mm(self) -> Array:
        """Position of the ball relative to the socket, (n, 3) mm: always zero."""
        return np.zeros((len(self.q), 3))


P = TypeVar("P", bound="PoseTable | TouchTable")


def last_moves(table: PoseTable | TouchTable) -> Array | None:
    """Return the last move of each joint, (n, axes) rad, or None if the rows do not contain it."""
    return None if table.came_from is None else table.q - table.came_from


def counted_back(table: P, turns_rad: Array) -> P:
    """Return the table with turns_rad (n, axes), multiples of a turn, subtracted from the joint angles."""
    came_from = None if table.came_from is None else table.came_from - turns_rad
    return replace(table, q=table.q - turns_rad, came_from=came_from)


@dataclass(frozen=True)
class PathTable(Table):
    """Tracker recording along paths: times t_s (n,) s and positions xyz_mm (n, 3) in the tracker's frame."""

    test: ClassVar[TestName] = "path"
    t_s: Array
    xyz_mm: Array

    @property
    def q(self) -> Array:
        """Empty array (n, 0) rad: a tracker reads no joints, and the clocks of tracker and robot differ."""
        return np.empty((len(self.t_s), 0))


def content_order(table: Table) -> Integers:
    """Return the row indices (n,) that sort a table by content.

    Tables that differ only in the order of rows become identical. Sums, random draws, neighbourhoods and ties then do
    not depend on that order.
    """
    columns = [values.reshape(len(values), -1).T for name, values in vars(table).items() if _is_content(name, values)]
    keys = [column for of_field in reversed(columns) for column in of_field[::-1]]
    return np.asarray(np.lexsort(keys), dtype=np.int64)


def _is_content(name: str, values: object) -> bool:
    return name != "row" and isinstance(values, np.ndarray)


def in_content_order(table: P) -> P:
    """Sort a table of positions by `content_order`. Rows keep their numbers in the file."""
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
