"""The rules of every table that is read, of any program: numbers of a size that is measured, time in order.

Import says the same of a file, with its lines. A run directory is only files, and one that was edited, or made by
another program, had a time of nan or 1e300 in it, which stopped the analysis of all runs beside it.
"""

from __future__ import annotations

import numpy as np

from analysis.kinematics.arm import Array, Mask
from analysis.traces.tables import Table
from rigs.errors import FileError

LARGEST = 1e12
"""No angle, length or time of a measurement is larger, in any unit that someone may have taken by mistake."""
_REMEDY = "restore the run from a copy, or correct its table and import it again"


def hold_table(table: Table, where: str) -> None:
    """Raises FileError for the first row that no import lets through; `where` names the table."""
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
            what = f"row {row + 1}: time does not increase, {t_s[row]:g} after {t_s[row - 1]:g} s"
            raise FileError(where, what, _REMEDY)


def _hold_rows(is_good: Mask, name: str, rows: Array, why: str, where: str) -> None:
    """Raises FileError for the first row (n, k) with a value that is not good (n, k), as nan never is."""
    good = is_good.all(axis=1)
    if not good.all():
        row = int(np.argmin(good))
        values = ", ".join(f"{value:g}" for value in rows[row])
        raise FileError(where, f"row {row + 1} has {name} = {values}, {why}", _REMEDY)
