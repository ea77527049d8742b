"""Convert between tables in memory (rad, mm) and the columns of docs/tables.md (degrees, mm)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import takewhile

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from analysis.robot.kinematics.arm import RAIL_MM, Array, Integers, Mask
from analysis.runs.table_format import kind_named
from analysis.runs.table_layout import RAIL, joint_columns
from analysis.runs.tables import Table
from daq.store.chunk import array_of
from rigs.errors import FileError
from rigs.schema.vocabulary import DRIVEN_AXES, FEWEST_AXES, MOST_AXES, Direction, TestName


@dataclass(frozen=True)
class Rows:
    """Columns of docs/tables.md for a kind of test, without extra columns."""

    columns: pa.Table

    @cached_property
    def axes(self) -> int:
        """Number of joints in the table; cells of unrelated columns, such as a gripper, stay text. Fewer than the
        minimum means six joints with missing columns."""
        joints = list(takewhile(self._is_measured, joint_columns(MOST_AXES)))
        return len(joints) if len(joints) >= FEWEST_AXES else DRIVEN_AXES

    @cached_property
    def rail(self) -> bool:
        """Whether the table contains rail positions; an unrelated column of that name stays text."""
        return self._is_measured(RAIL)

    @property
    def q(self) -> Array:
        """Angles (n, axes) rad."""
        return np.radians(self.stack(joint_columns(self.axes)))

    def has(self, names: tuple[str, ...]) -> bool:
        """Return whether the table has all of these columns."""
        return set(names) <= set(self.columns.column_names)

    def floats(self, name: str) -> Array:
        """Return a column (n,) of numbers."""
        return np.asarray(array_of(self.columns[name]), dtype=float)

    def stack(self, names: tuple[str, ...]) -> Array:
        """Return columns of numbers side by side, (n, k)."""
        return np.stack([self.floats(name) for name in names], axis=1)

    def counts(self, name: str) -> Integers:
        """Return a column (n,) of counts."""
        return array_of(self.columns[name])

    def words(self, name: str) -> NDArray[np.str_]:
        """Return a column (n,) of words without a unit."""
        return np.array(self.columns[name].to_pylist(), dtype=np.str_)

    def times(self) -> Array:
        """Return times (n,) s, zeros if the table has none."""
        return self.floats("t_s") if self.has(("t_s",)) else np.zeros(self.columns.num_rows)

    def with_rail(self, q: Array, name: str = RAIL) -> Array:
        """Return angles q (n, axes) rad with the rail position in m, if the table contains it."""
        return np.column_stack([q, self.floats(name) / RAIL_MM]) if self.rail else q

    def _is_measured(self, name: str) -> bool:
        schema = self.columns.schema
        return name in schema.names and pa.types.is_floating(schema.field(name).type)


def table_from(columns: pa.Table, test: TestName, direction: Direction | None, where: str) -> Table:
    """Return a table in memory from the columns of docs/tables.md, without extra columns.

    Raises FileError for columns of a different test, for no rows, and for content rejected by imports.
    """
    rows, kind = Rows(columns), kind_named(test)
    missing = [name for name in kind.layout(rows.axes).required if name not in columns.column_names]
    if missing or not columns.num_rows:
        problem = f"the table has no {', '.join(missing) or 'rows'}"
        raise FileError(where, problem, "import the table again")
    table = kind.table_of(rows, direction, where)
    hold_table(table, where)
    return table


def u_lag_s_of(columns: pa.Table) -> float:
    """Return the common standard uncertainty in s of the gauges' time relative to the joints'; 0 if not stated."""
    stated = "u_lag_s" in columns.column_names and pa.types.is_floating(columns.schema.field("u_lag_s").type)
    return float(Rows(columns).floats("u_lag_s").max(initial=0.0)) if stated else 0.0


def columns_of(table: Table) -> pa.Table:
    """Return the columns of docs/tables.md in order: degrees and mm. Times that are all zero are left out."""
    return pa.table({name: pa.array(values) for name, values in table.kind.columns(table).items()})


def joint_cells(
    q: Array, *, rail: bool, names: Callable[[int], tuple[str, ...]] = joint_columns, rail_name: str = RAIL
) -> dict[str, Array]:
    """Return the columns of angles q (n, axes) rad by name, in degrees, followed by a rail in mm."""
    axes = q.shape[1] - rail
    cells = dict(zip(names(axes), np.degrees(q[:, :axes]).T, strict=True))
    return cells | ({rail_name: RAIL_MM * q[:, axes]} if rail else {})


# ----------------------------------------------------------------------------------------------------------------------
# Rules for every table from any program: finite plausible numbers, increasing times.
#
# Import reports the same with line numbers. A run directory consists of files, and one that was edited, or written by
# another
# program, had a time of nan or 1e300, which stopped the analysis of all runs with it.

LARGEST = 1e12
"""Limit of angles, lengths and times, in any unit chosen by mistake."""
_REMEDY = "restore the run from a copy, or correct the table and import it again"


def hold_table(table: Table, where: str) -> None:
    """Raise FileError for the first row rejected by imports; `where` names the table."""
    columns = {name: values for name, values in vars(table).items() if isinstance(values, np.ndarray)}
    for field, values in columns.items():
        name = "g1_mm" if field == "g_mm" and values.ndim == 1 else field
        rows = values.reshape(len(values), -1)
        if values.dtype.kind == "f":
            _hold_rows(np.abs(rows) <= LARGEST, name, rows, "which is no measured value", where)
            if name.startswith("u_"):
                _hold_rows(rows >= 0, name, rows, "below zero", where)
        elif values.dtype.kind == "i":
            _hold_rows(rows >= 1, name, rows, "and it counts from 1", where)
    if table.kind.in_order_of_time:
        t_s = columns["t_s"]
        back = np.flatnonzero(np.diff(t_s) <= 0)
        if len(back):
            row = int(back[0]) + 1
            problem = f"row {row + 1}: time does not increase, {t_s[row]:g} after {t_s[row - 1]:g} s"
            raise FileError(where, problem, _REMEDY)


def _hold_rows(is_good: Mask, name: str, rows: Array, why: str, where: str) -> None:
    """Raise FileError for the first of the rows (n, k) with an invalid value (mask (n, k)), including nan."""
    good = is_good.all(axis=1)
    if not good.all():
        row = int(np.argmin(good))
        values = ", ".join(f"{value:g}" for value in rows[row])
        raise FileError(where, f"row {row + 1} has {name} = {values}, {why}", _REMEDY)
