"""What was measured, in the tables of docs/tables.md: the one form that every evaluation, simulation and fit takes.

Recorded runs become tables by alignment, imported ones by reading; simulation fills the same tables.
Angles are radians and lengths mm here; in files (`analysis.runs.csv_tables`) degrees and mm.
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
    """What every table has: the test that it is of, reported joints q (n, axes) rad, those of a rail, which
    carries the arm, in a column more (`rail`)."""

    if TYPE_CHECKING:

        @property
        def test(self) -> TestName: ...
        @property
        def q(self) -> Array: ...

    rail = False

    @property
    def kind(self) -> Kind[Self]:
        """The kind of test that it is of, which answers what depends on it."""
        return cast("Kind[Self]", kind_named(self.test))

    @property
    def rows(self) -> Integers:
        """The row of the file (n,) that each reading is, or the first of several that are one."""
        row: Integers | None = getattr(self, "row", None)
        return np.arange(1, len(self.q) + 1) if row is None else row


@dataclass(frozen=True)
class CircleTable(Table):
    """One circle driven in one direction, lead-in and lead-out included where they were recorded.

    t_s (n,); q (n, 6) rad as reported; g_mm (n, 2) of g1 and g2; u_t_s (n,): standard uncertainty of each row's time
    beside what all rows share, None where nothing is known of it.
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

    target, orientation (n,) count from 1; polar, azimuth (n,) rad; q (n, 6) rad; g_mm (n,): |B - TCP| less the
    link's set length; t_s (n,), zeros where the table has no time.
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

    target, round (n,) count from 1; approach (n,) of str; q (n, 6) rad; g_mm (n,); t_s (n,) as in a radial table.
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
    """Poses of the tool as a tracker saw them, in the tracker's frame.

    q (n, axes) rad, of an arm on a rail with a column more, where the rail stands in m (`rail`);
    xyz_mm (n, 3); rpy (n, 3) rad, fixed-axis roll-pitch-yaw, or None where only places were measured;
    row (n,): from 1, the row of the file that each is, or the first of several; None where they are 1 … n; came_from
    (n, axes) rad: where each joint was before its last move, which says on which side of its play it stands, or None
    where it came from the pose before.
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
    """Touches: the tool's ball seated in sockets that are fixed in the world, in one posture after the other.

    socket (n,) of str; q (n, axes) rad, with a rail as of poses; came_from (n, axes) rad and row (n,) as of poses.
    """

    test: ClassVar[TestName] = "touch"
    socket: NDArray[np.str_]
    q: Array
    came_from: Array | None = None
    row: Integers | None = None
    rail: bool = False

    @property
    def xyz_mm(self) -> Array:
        """Where the ball is in its socket (n, 3) mm: in its middle."""
        return np.zeros((len(self.q), 3))


P = TypeVar("P", PoseTable, TouchTable)


@dataclass(frozen=True)
class PathTable(Table):
    """What a tracker wrote while the tool followed paths: t_s (n,); xyz_mm (n, 3) in the tracker's frame."""

    test: ClassVar[TestName] = "path"
    t_s: Array
    xyz_mm: Array

    @property
    def q(self) -> Array:
        """No joints (n, 0): a tracker reads none, and its clock is not the robot's."""
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
"""Tables whose readings are those of gauges, each at its time."""
PlaceTable = PoseTable | TouchTable
"""Tables whose readings are places, three coordinates a row, each of a posture."""
Evidence = GaugeTable | PlaceTable
"""Tables of what was read beside joint angles, from which an arm is diagnosed."""
