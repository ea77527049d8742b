"""Common columns of tests with stops: times, and joint positions before the last move; and repeated visits."""

from __future__ import annotations

import numpy as np

from analysis.robot.kinematics.arm import Array, Mask
from analysis.runs.stands import STANDSTILL_MM, standstill_starts
from analysis.runs.table_layout import RAIL, RAIL_FROM, came_from_columns
from analysis.runs.table_rows import Rows, joint_cells
from analysis.runs.tables import PlaceTable, TargetTable


def visit_starts(table: TargetTable, labels: Array) -> Mask:
    """Return a mask (n,) of the rows at which a new standstill starts.

    A standstill starts if the joints moved, or if the labels (n, k) or the reading differ from the previous row.
    """
    differs = (np.diff(labels, axis=0) != 0).any(axis=1) | (np.abs(np.diff(table.g_mm)) > STANDSTILL_MM)
    return standstill_starts(table.q, np.asarray(differs))


def timed(t_s: Array) -> dict[str, Array]:
    """Return the column of times t_s (n,) s, empty if all are zero."""
    return {"t_s": t_s} if t_s.any() else {}


def came_from_of(rows: Rows) -> Array | None:
    """Return the previous joint positions (n, axes) rad from the columns of a file, None if absent; a rail defaults to
    its present position."""
    names = came_from_columns(rows.axes)
    if not rows.has(names):
        return None
    return rows.with_rail(np.radians(rows.stack(names)), RAIL_FROM if rows.has((RAIL_FROM,)) else RAIL)


def came_from_cells(table: PlaceTable) -> dict[str, Array]:
    """Return the columns (n,) with the previous joint positions, in degrees and mm, empty if unknown."""
    if table.came_from is None:
        return {}
    return joint_cells(table.came_from, rail=table.rail, names=came_from_columns, rail_name=RAIL_FROM)
