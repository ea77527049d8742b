"""Tables of docs/tables.md in memory: the common input of evaluation, simulation and fits.

Recorded runs are aligned to tables, and imported ones are read from files. Simulations produce the same tables. Angles
are in rad and lengths in mm, but files contain degrees and mm (`analysis.runs.table_format`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from analysis.robot.kinematics.arm import Array, Integers, Mask
from rigs.schema.vocabulary import CircleTest, Direction, TestName

SAME_RAD = 3e-4
"""Largest difference of each joint angle between equal postures, three steps of angles reported by controllers."""


@dataclass(frozen=True)
class Table(ABC):
    """Common part of all tables: the test, and reported joint angles q (n, axes) rad. `rail`: q has an additional
    column with the rail position in m.
    """

    if TYPE_CHECKING:

        @property
        def test(self) -> TestName: ...
        @property
        def q(self) -> Array: ...

    in_order_of_time: ClassVar[bool] = False
    """True if the rows have increasing times."""
    swept: ClassVar[bool] = False
    """True if joints move during the reading."""
    rail = False

    @property
    @abstractmethod
    def readings(self) -> Array: ...

    def with_readings(self, values: Array) -> Self:
        raise TypeError(f"a {self.test} table has no readings of gauges")

    @property
    def rows(self) -> Integers:
        """Row number (n,) in the file of each reading, or of the first averaged reading."""
        row: Integers | None = getattr(self, "row", None)
        return np.arange(1, len(self.q) + 1) if row is None else row

    @property
    def numbers(self) -> Integers:
        """Number (n,) identifying each row to the user: row in the file, or target."""
        return self.rows

    @property
    def driven_direction(self) -> Direction | None:
        return None

    @property
    def last_moves(self) -> Array | None:
        return None

    @property
    def sides(self) -> Integers | None:
        """Side of the backlash for each joint (n, axes): direction of the last move, -1 or 1, or 0 if the joint did not
        move.

        None if the table does not contain the approach of the joints.
        """
        return None

    @property
    def lost(self) -> Mask:
        """Mask (n,) of the rows without a measurement, identified by the value that an instrument then writes."""
        return np.zeros(len(self.q), dtype=bool)

    def thinned(self, count: int) -> Self:
        """Reduce a table of millions of rows to about `count` rows. Shorter tables are not changed."""
        return self


@dataclass(frozen=True)
class CircleTable(Table):
    """A circle driven in one direction, including the recorded lead-in and lead-out.

    t_s (n,) s; q (n, 6) rad as reported; g_mm (n, 2): readings of g1 and g2; u_t_s (n,): individual standard
    uncertainty of the times, None if unknown.
    """

    in_order_of_time = swept = True
    test: CircleTest
    direction: Direction
    t_s: Array
    q: Array
    g_mm: Array
    u_t_s: Array | None = None

    @property
    def readings(self) -> Array:
        return self.g_mm

    def with_readings(self, values: Array) -> Self:
        return replace(self, g_mm=values)

    @property
    def driven_direction(self) -> Direction:
        return self.direction

    def thinned(self, count: int) -> CircleTable:
        """About `count` rows at equal intervals, without the uncertainty of their times."""
        if len(self.q) <= count:
            return self
        rows = slice(None, None, len(self.q) // count)
        return CircleTable(self.test, self.direction, self.t_s[rows], self.q[rows], self.g_mm[rows])


@dataclass(frozen=True)
class TargetTable(Table):
    """Common part of tables of one gauge at the targets of a hemisphere."""

    if TYPE_CHECKING:

        @property
        def target(self) -> Integers: ...
        @property
        def t_s(self) -> Array: ...
        @property
        def g_mm(self) -> Array: ...

    @property
    def readings(self) -> Array:
        return self.g_mm[:, None]

    def with_readings(self, values: Array) -> Self:
        return replace(self, g_mm=values[:, 0])  # type: ignore[call-arg]  # a field of each test at targets

    @property
    def numbers(self) -> Integers:
        """Target number (n,) of each row."""
        return self.target


@dataclass(frozen=True)
class RadialTable(TargetTable):
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
class RepeatabilityTable(TargetTable):
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
class PlaceTable(Table):
    """Common part of tables of positions, three coordinates per row, each with a posture.

    came_from (n, axes) rad: joint angles before the last move, which determine the side of backlash, or None if they
    are not stated.
    """

    if TYPE_CHECKING:

        @property
        def came_from(self) -> Array | None: ...
        @property
        def xyz_mm(self) -> Array: ...

    @property
    def readings(self) -> Array:
        return self.xyz_mm

    @property
    def last_moves(self) -> Array | None:
        return None if self.came_from is None else self.q - self.came_from

    @property
    def sides(self) -> Integers | None:
        """Direction of the last move of each joint (n, axes)."""
        if self.last_moves is None:
            return None
        return np.where(np.abs(self.last_moves) > SAME_RAD, np.sign(self.last_moves), 0).astype(np.int64)

    def counted_back(self, turns_rad: Array) -> Self:
        """Table with turns_rad (n, axes), multiples of a turn, subtracted from the joint angles."""
        came_from = None if self.came_from is None else self.came_from - turns_rad
        return self.with_fields(q=self.q - turns_rad, came_from=came_from)

    def in_content_order(self) -> Self:
        """Table sorted by `content_order`; each row keeps its number in the file."""
        order = content_order(self)
        columns = {name: values[order] for name, values in vars(self).items() if _is_content(name, values)}
        return self.with_fields(**columns, row=self.rows[order])

    def with_fields(self, **fields: Array | Integers | None) -> Self:
        """Table with other values of fields that every table of positions has."""
        return replace(self, **fields)


@dataclass(frozen=True)
class PoseTable(PlaceTable):
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

    @property
    def lost(self) -> Mask:
        """Mask (n,) of positions 0, 0, 0, written by a tracker that lost its target."""
        return np.asarray((self.xyz_mm == 0).all(axis=1))


@dataclass(frozen=True)
class TouchTable(PlaceTable):
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


@dataclass(frozen=True)
class PathTable(Table):
    """Tracker recording along paths: times t_s (n,) s and positions xyz_mm (n, 3) in the tracker's frame."""

    in_order_of_time = True
    test: ClassVar[TestName] = "path"
    t_s: Array
    xyz_mm: Array

    @property
    def q(self) -> Array:
        """Empty array (n, 0) rad: a tracker reads no joints, and the clocks of tracker and robot differ."""
        return np.empty((len(self.t_s), 0))

    @property
    def readings(self) -> Array:
        return self.xyz_mm


def content_order(table: Table) -> Integers:
    """Row indices (n,) that sort a table by content.

    Tables that differ only in the order of rows become identical. Sums, random draws, neighbourhoods and ties then do
    not depend on that order.
    """
    columns = [values.reshape(len(values), -1).T for name, values in vars(table).items() if _is_content(name, values)]
    keys = [column for of_field in reversed(columns) for column in of_field[::-1]]
    return np.asarray(np.lexsort(keys), dtype=np.int64)


def _is_content(name: str, values: object) -> bool:
    return name != "row" and isinstance(values, np.ndarray)


GaugeTable = CircleTable | TargetTable
"""Tables of gauge readings with times."""
