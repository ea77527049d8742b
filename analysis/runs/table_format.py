"""Test kinds, as far as tables need them: columns in files, and readings in a recorded run.

A kind is a class. Rig's own are listed here, others are offered by installed packages as entry points `rig.tests`. What
the layers above ask of the same class is in `analysis.procedures.shared.test_kind`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from importlib.metadata import EntryPoint
from typing import TYPE_CHECKING, ClassVar, Generic, TypeVar, get_args

import numpy as np

from analysis.runs.tables import Table
from rigs.errors import FileError
from rigs.schema.vocabulary import OTHER_TESTS, TestName

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
_OWN: dict[TestName, str] = {
    "yaw": "circle:Yaw",
    "roll": "circle:Roll",
    "radial": "radial:Radial",
    "repeatability": "repeatability:Repeatability",
    "pose": "pose:Pose",
    "touch": "touch:Touch",
    "path": "path:Path",
}
"""Classes of rig's own tests in `analysis.procedures`, imported when a table of the test is first read."""
TESTS: tuple[TestName, ...] = get_args(TestName)
"""All tests, in the order in which they are listed everywhere."""


class TableFormat(ABC, Generic[T]):
    """Columns of a test's table, and its readings in a recorded run."""

    test: ClassVar[TestName]
    gauges: ClassVar[tuple[Gauge, ...]] = ()
    """Gauges used by the test."""
    certified: ClassVar[tuple[str, ...]] = ()
    """Parts of the rig file that may have a certificate and determine the readings: gauges, ball, link."""

    @abstractmethod
    def layout(self, axes: int = 6, *, rail: bool = False) -> Layout:
        """Columns of the table for an arm with this number of axes, with or without a rail."""

    @abstractmethod
    def table_of(self, rows: Rows, direction: Direction | None, where: str) -> T:
        """Convert the columns of a file to a table. Raises FileError."""

    @abstractmethod
    def columns(self, table: T) -> Mapping[str, Array | Integers | Sequence[str] | pa.Array]:
        """Columns (n,) of docs/tables.md by name, in the documented order, in degrees and mm."""

    def recorded(self, data: Aligned, rig: Rig, direction: Direction | None, where: str) -> tuple[T, list[str]]:
        """Convert a recorded run to a table, and return it with the doubts as text. Raises FileError."""
        problem = f"a recorded {self.test} run has no measuring instrument"
        raise FileError(where, problem, "import the table with rig import", code="test.not_recorded")

    def stands(self, table: T) -> Mask | None:
        """Mask (n,) of the rows that start a standstill of the robot.

        None if no two rows belong to the same standstill, because the robot kept moving or each row is a separate
        visit.
        """
        return None

    def averaged(self, table: T, first: Mask, mean: Callable[[Array], Array]) -> T:
        """Reduce a table to a row for each standstill.

        first (n,): True for the first row of a standstill, which also supplies the labels. mean: function that averages
        values (n, …) over each standstill to (s, …).
        """
        columns = {name: column for name, column in vars(table).items() if isinstance(column, np.ndarray)}
        return replace(table, **{name: mean(c) if c.dtype.kind == "f" else c[first] for name, c in columns.items()})


@cache
def format_of(test: TestName) -> TableFormat[Table]:
    """The kind of a test, with its table format. Raises FileError if the package that offers it is unusable."""
    own = EntryPoint(test, f"analysis.procedures.{_OWN[test]}", "rig.tests") if test in _OWN else None
    offer = own or OTHER_TESTS[test]
    try:
        kind: TableFormat[Table] = offer.load()()
        if kind.test == test:
            return kind
        reason = f"it is the class of {kind.test!r}"
    except Exception as error:  # noqa: BLE001 - whatever a foreign module raises as it is imported
        reason = str(error)
    problem = f"{offer.value}, which a package offers, cannot be used: {reason}"
    remedy = "offer a class of test kinds, as docs/how-to/add-a-test-kind.md shows, or uninstall that package"
    raise FileError(f"test {test}", problem, remedy, code="test.unusable")
