"""Convert between tables in memory (rad, mm) and the columns of docs/tables.md (degrees, mm)."""

from __future__ import annotations

import numpy as np
import pyarrow as pa

from analysis.robot.kinematics.arm import Array, Mask
from analysis.runs.table_format import format_of
from analysis.runs.table_rows import Rows
from analysis.runs.tables import Table
from rigs.errors import FileError
from rigs.schema.vocabulary import Direction, TestName


def table_from(columns: pa.Table, test: TestName, direction: Direction | None, where: str) -> Table:
    """Convert columns of docs/tables.md to a table in memory, ignoring additional columns.

    Raises FileError for columns of a different test, for an empty table, and for any content that import rejects.
    """
    rows, table_format = Rows(columns), format_of(test)
    missing = [name for name in table_format.layout(rows.axes).required if name not in columns.column_names]
    if missing or not columns.num_rows:
        problem = f"the table has no {', '.join(missing) or 'rows'}"
        raise FileError(where, problem, "import the table again", code="table.columns")
    table = table_format.table_of(rows, direction, where)
    check_table_rows(table, where)
    return table


def u_lag_s_of(columns: pa.Table) -> float:
    """Common standard uncertainty in s of the gauges' time relative to the joints', 0 if not stated."""
    stated = "u_lag_s" in columns.column_names and pa.types.is_floating(columns.schema.field("u_lag_s").type)
    return float(Rows(columns).floats("u_lag_s").max(initial=0.0)) if stated else 0.0


def columns_of(table: Table) -> pa.Table:
    """Convert a table to the columns of docs/tables.md, in their documented order, in degrees and mm.

    Times that are all zero are omitted.
    """
    return pa.table({name: pa.array(values) for name, values in format_of(table.test).columns(table).items()})


# ----------------------------------------------------------------------------------------------------------------------
# Rules for all tables from any program: finite, plausible numbers and increasing times.
#
# Import reports violations with line numbers. Run directories must be checked too, because their files may have been
# edited or written by another program. In one run, a time of nan or 1e300 stopped the analysis of all runs.

LARGEST = 1e12
"""Largest plausible angle, length or time, in any unit that may have been chosen by mistake."""
_REMEDY = "restore the run from a copy, or correct and re-import the table"


def check_table_rows(table: Table, where: str) -> None:
    """Raise FileError for the first row that import would reject. `where` names the table."""
    columns = {name: values for name, values in vars(table).items() if isinstance(values, np.ndarray)}
    for field, values in columns.items():
        name = "g1_mm" if field == "g_mm" and values.ndim == 1 else field
        rows = values.reshape(len(values), -1)
        if values.dtype.kind == "f":
            _check_rows(np.abs(rows) <= LARGEST, name, rows, "which is not a plausible measured value", where)
            if name.startswith("u_"):
                _check_rows(rows >= 0, name, rows, "below zero", where)
        elif values.dtype.kind == "i":
            _check_rows(rows >= 1, name, rows, "but counting starts at 1", where)
    if table.in_order_of_time:
        t_s = columns["t_s"]
        back = np.flatnonzero(np.diff(t_s) <= 0)
        if len(back):
            row = int(back[0]) + 1
            problem = f"row {row + 1}: time does not increase, {t_s[row]:g} s after {t_s[row - 1]:g} s"
            raise FileError(where, problem, _REMEDY, code="table.times")


def _check_rows(is_good: Mask, name: str, rows: Array, why: str, where: str) -> None:
    """Raise FileError for the first of the rows (n, k) with an invalid value (mask (n, k)), including nan."""
    good = is_good.all(axis=1)
    if not good.all():
        row = int(np.argmin(good))
        values = ", ".join(f"{value:g}" for value in rows[row])
        raise FileError(where, f"row {row + 1} has {name} = {values}, {why}", _REMEDY, code="table.value")
