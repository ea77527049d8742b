"""Format of a test's table: its columns in files, and the table of a recorded run.

Each test implements it as `PART` in the module `format` of its package.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING, Protocol, TypeVar

import numpy as np

from analysis.runs.parts_of_tests import TestPart, part_of
from analysis.runs.tables import Table
from rigs.errors import FileError
from rigs.schema.vocabulary import TestName

if TYPE_CHECKING:
    import pyarrow as pa

    from analysis.robot.kinematics.arm import Array, Integers, Mask
    from analysis.runs.align import Aligned
    from analysis.runs.table_layout import Layout
    from analysis.runs.table_rows import Rows
    from rigs.rig import Rig
    from rigs.schema.effect import Gauge
    from rigs.schema.vocabulary import Direction

T = TypeVar("T", bound=Table)


class TableFormat(TestPart, Protocol[T]):
    """Columns of a test's table, and its readings in a recorded run."""

    gauges: tuple[Gauge, ...] = ()
    """Gauges used by the test."""
    certified: tuple[str, ...] = ()
    """Parts of the rig file that may have a certificate and determine the readings: gauges, ball, link."""

    @abstractmethod
    def layout(self, axes: int = 6, *, rail: bool = False) -> Layout:
        """Return the columns of the table for an arm with this number of axes, with or without a rail."""

    @abstractmethod
    def table_of(self, rows: Rows, direction: Direction | None, where: str) -> T:
        """Convert the columns of a file to a table. Raises FileError."""

    @abstractmethod
    def columns(self, table: T) -> Mapping[str, Array | Integers | Sequence[str] | pa.Array]:
        """Return the columns (n,) of docs/tables.md by name, in the documented order, in degrees and mm."""

    def recorded(self, data: Aligned, rig: Rig, direction: Direction | None, where: str) -> tuple[T, list[str]]:
        """Convert a recorded run to a table, and return it with the doubts as text. Raises FileError."""
        raise FileError(
            where, f"a recorded {self.test} run has no measuring instrument", "import the table with rig import"
        )

    def stands(self, table: T) -> Mask | None:
        """Return a mask (n,) of the rows that start a standstill of the robot.

        None if no two rows belong to the same standstill, because the robot kept moving or each row is a separate
        visit.
        """
        return None

    def averaged(self, table: T, first: Mask, mean: Callable[[Array], Array]) -> T:
        """Return the table with a row for each standstill.

        first (n,): True for the first row of a standstill, which also supplies the labels. mean: function that averages
        values (n, …) over each standstill to (s, …).
        """
        columns = {name: column for name, column in vars(table).items() if isinstance(column, np.ndarray)}
        return replace(table, **{name: mean(c) if c.dtype.kind == "f" else c[first] for name, c in columns.items()})


@cache
def format_of(test: TestName) -> TableFormat[Table]:
    """Return the table format of a test. Raises FileError if its package is unusable."""
    return part_of(test, "format")
