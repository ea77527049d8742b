"""Measurements as the tables of docs/tables.md, the common input of evaluation, simulation and fits.

Recorded runs become tables by alignment, imported ones by reading; simulation fills the same tables. Angles are radians
and lengths mm here; in files (`analysis.runs.csv_tables`) degrees and mm.
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
"""Joint angles that all differ by less than this count as the same posture. Controllers report angles in steps of about
a third of it."""


@dataclass(frozen=True)
class Table(ABC):
    """Common part of tables: the test, and reported joints q (n, axes) rad, with a rail position as additional
    column (`rail`)."""

    if TYPE_CHECKING:

        @property
        def test(self) -> TestName: ...
        @property
        def q(self) -> Array: ...

    in_order_of_time: ClassVar[bool] = False
    """Whether rows have increasing times."""
    swept: ClassVar[bool] = False
    """Whether joints move during the reading."""
    rail = False

    @property
    @abstractmethod
    def readings(self) -> Array:
        """Readings (n, k), in mm: a column for each gauge, or three coordinates."""

    def with_readings(self, values: Array) -> Self:
        """Return the table with other readings (n, k) mm, of gauges."""
        raise TypeError(f"a {self.test} table has no readings of gauges")

    @property
    def rows(self) -> Integers:
        """File row (n,) of each reading, or the first of several averaged ones."""
        row: Integers | None = getattr(self, "row", None)
        return np.arange(1, len(self.q) + 1) if row is None else row

    @property
    def numbers(self) -> Integers:
        """Number (n,) identifying each row to the user: row in the file, or target."""
        return self.rows

    @property
    def driven_direction(self) -> Direction | None:
        """Direction of the motion; None if the test is not driven in two directions."""
        return None

    @property
    def last_moves(self) -> Array | None:
        """Rotation of each joint (n, axes) rad in the last move; None if the rows do not state it."""
        return None

    @property
    def sides(self) -> Integers | None:
        """Side of the backlash for each joint (n, axes): direction of the last move, -1 or 1, 0 if the joint did not
        move; None if rows do not contain the approach of the joints."""
        return None

    @property
    def lost(self) -> Mask:
        """Mask (n,) of the rows without a measurement, by the value that an instrument writes in that case."""
        return np.zeros(len(self.q), dtype=bool)

    def thinned(self, count: int) -> Self:
        """Return a table of about `count` rows at most if the test may have millions; others are short."""
        return self


@dataclass(frozen=True)
class CircleTable(Table):
    """One circle driven in one direction, including recorded lead-in and lead-out.

    t_s (n,); q (n, 6) rad as reported; g_mm (n, 2) of g1 and g2; u_t_s (n,): individual standard uncertainty of each
    row's time, None if unknown.
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
        """Readings (n, 2) mm of both gauges."""
        return self.g_mm

    def with_readings(self, values: Array) -> Self:
        """Return the table with other readings (n, 2) mm."""
        return replace(self, g_mm=values)

    @property
    def driven_direction(self) -> Direction:
        """Direction of the circle."""
        return self.direction

    def thinned(self, count: int) -> CircleTable:
        """Return about `count` rows at equal intervals, without the uncertainty of their times."""
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
        """Readings (n, 1) mm of the gauge."""
        return self.g_mm[:, None]

    def with_readings(self, values: Array) -> Self:
        """Return the table with other readings (n, 1) mm."""
        return replace(self, g_mm=values[:, 0])  # type: ignore[call-arg]  # a field of each test at targets

    @property
    def numbers(self) -> Integers:
        """Target number (n,) of each row."""
        return self.target


@dataclass(frozen=True)
class RadialTable(TargetTable):
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
class RepeatabilityTable(TargetTable):
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
        """Positions (n, 3) mm."""
        return self.xyz_mm

    @property
    def last_moves(self) -> Array | None:
        """Rotation of each joint (n, axes) rad since `came_from`."""
        return None if self.came_from is None else self.q - self.came_from

    @property
    def sides(self) -> Integers | None:
        """Direction of the last move of each joint (n, axes)."""
        if self.last_moves is None:
            return None
        return np.where(np.abs(self.last_moves) > SAME_RAD, np.sign(self.last_moves), 0).astype(np.int64)

    def counted_back(self, turns_rad: Array) -> Self:
        """Return the table with joints counted back by full turns (n, axes) rad."""
        came_from = None if self.came_from is None else self.came_from - turns_rad
        return self.with_fields(q=self.q - turns_rad, came_from=came_from)

    def in_content_order(self) -> Self:
        """Return the table sorted by `content_order`; each row keeps its number in the file."""
        order = content_order(self)
        columns = {name: values[order] for name, values in vars(self).items() if _is_content(name, values)}
        return self.with_fields(**columns, row=self.rows[order])

    def with_fields(self, **fields: Array | Integers | None) -> Self:
        """Return the table with other values of fields that every table of positions has."""
        return replace(self, **fields)


@dataclass(frozen=True)
class PoseTable(PlaceTable):
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

    @property
    def lost(self) -> Mask:
        """Mask (n,) of positions 0, 0, 0, written by a tracker that lost its target."""
        return np.asarray((self.xyz_mm == 0).all(axis=1))


@dataclass(frozen=True)
class TouchTable(PlaceTable):
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


@dataclass(frozen=True)
class PathTable(Table):
    """Tracker recording along paths: t_s (n,); xyz_mm (n, 3) in the tracker's frame."""

    in_order_of_time = True
    test: ClassVar[TestName] = "path"
    t_s: Array
    xyz_mm: Array

    @property
    def q(self) -> Array:
        """Empty joints (n, 0): a tracker reads none, and its clock is not the robot's."""
        return np.empty((len(self.t_s), 0))

    @property
    def readings(self) -> Array:
        """Positions (n, 3) mm."""
        return self.xyz_mm


def content_order(table: Table) -> Integers:
    """Return the rows (n,) of a table sorted by what they say. Equal tables in another order of rows are sorted alike,
    so that sums, random draws, neighbourhoods and ties do not depend on that order."""
    columns = [values.reshape(len(values), -1).T for name, values in vars(table).items() if _is_content(name, values)]
    keys = [column for of_field in reversed(columns) for column in of_field[::-1]]
    return np.asarray(np.lexsort(keys), dtype=np.int64)


def _is_content(name: str, values: object) -> bool:
    return name != "row" and isinstance(values, np.ndarray)


GaugeTable = CircleTable | TargetTable
"""Tables of gauge readings with times."""
Evidence = GaugeTable | PlaceTable
"""Tables with joint angles, usable for a diagnosis of the arm."""
