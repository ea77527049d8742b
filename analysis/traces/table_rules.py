"""The rules of every table that is read, of any program: numbers of a size that is measured, time in order.

Import says the same of a file, with its lines. A run directory is only files, and one that was edited, or made by
another program, had a time of nan or 1e300 in it, which stopped the analysis of all runs beside it.
"""

from __future__ import annotations

import numpy as np

from analysis.kinematics.arm import Array, Integers
from analysis.traces.tables import CircleTable, PathTable, PoseTable, RadialTable, RepeatabilityTable, Table, TouchTable
from rigs.errors import FileError

LARGEST = 1e12
"""No angle, length or time of a measurement is larger, in any unit that someone may have taken by mistake."""
_REMEDY = "restore the run from a copy, or correct its table and import it again"


def hold_table(table: Table, where: str) -> None:
    """Raises FileError for the first row that no import lets through; `where` names the table."""
    for name, values in _numbers(table).items():
        rows = values.reshape(len(values), -1)
        good = (np.abs(rows) <= LARGEST).all(axis=1)  # nan is no number at all
        if not good.all():
            row = int(np.argmin(good))
            what = f"row {row + 1} has {name} = {_listed(rows[row])}, which is no measured value"
            raise FileError(where, what, _REMEDY)
    if isinstance(table, CircleTable | PathTable):
        _hold_times(table, where)
    if isinstance(table, RadialTable | RepeatabilityTable):
        for name, count in _counts(table).items():
            if (count < 1).any():
                row = int(np.argmax(count < 1))
                raise FileError(where, f"row {row + 1} has {name} = {count[row]}; it counts from 1", _REMEDY)


def _hold_times(table: CircleTable | PathTable, where: str) -> None:
    back = np.flatnonzero(np.diff(table.t_s) <= 0)
    if len(back):
        row = int(back[0]) + 1
        what = f"row {row + 1}: time does not increase, {table.t_s[row]:g} after {table.t_s[row - 1]:g} s"
        raise FileError(where, what, _REMEDY)
    if isinstance(table, CircleTable) and table.u_t_s is not None and (table.u_t_s < 0).any():
        row = int(np.argmax(table.u_t_s < 0))
        raise FileError(where, f"row {row + 1} has u_t_s = {table.u_t_s[row]:g}, below zero", _REMEDY)


def _numbers(table: Table) -> dict[str, Array]:
    """Columns of numbers (n,) or (n, k) by name."""
    match table:
        case CircleTable():
            u = {} if table.u_t_s is None else {"u_t_s": table.u_t_s}
            return {"t_s": table.t_s, "q": table.q, "g_mm": table.g_mm, **u}
        case PoseTable():
            turns = {} if table.rpy is None else {"rpy": table.rpy}
            return {"q": table.q, "xyz_mm": table.xyz_mm, **turns}
        case PathTable():
            return {"t_s": table.t_s, "xyz_mm": table.xyz_mm}
        case TouchTable():
            came = {} if table.came_from is None else {"came_from": table.came_from}
            return {"q": table.q, **came}
        case RadialTable():
            angles = {"polar": table.polar, "azimuth": table.azimuth}
            return {**angles, "t_s": table.t_s, "q": table.q, "g1_mm": table.g_mm}
        case RepeatabilityTable():
            return {"t_s": table.t_s, "q": table.q, "g1_mm": table.g_mm}


def _counts(table: RadialTable | RepeatabilityTable) -> dict[str, Integers]:
    """Columns of counts (n,) by name."""
    second = {"orientation": table.orientation} if isinstance(table, RadialTable) else {"round": table.round}
    return {"target": table.target, **second}


def _listed(values: Array) -> str:
    return ", ".join(f"{value:g}" for value in values)
