"""Several readings of one stand of the robot as one: only a visit after a move shows repeatability.

Readings at one stand scatter by the instrument alone. Taken for visits, three of them gave an RP of 0.008 mm, and made
the fits of a calibration, and what is held out of them, three times the same.
"""

from __future__ import annotations

import numpy as np

from analysis.kinematics.arm import Array, Integers, Mask
from analysis.traces.stands import STANDS_RAD
from analysis.traces.tables import Table

STANDS_MM = 1.0
"""Places or readings of one stand that differ by more are no readings of one thing; they are left as they are."""


def one_row_a_stand(table: Table) -> Table:
    """A table with neighbouring rows of one stand averaged; circles, driven, as they are."""
    first = _begins(table)
    if first is None or first.all():
        return table
    stand = np.cumsum(first) - 1
    count = np.bincount(stand)

    def mean(values: Array) -> Array:
        """Means (s, …) in the values' unit over each stand."""
        columns = values.reshape(len(values), -1).T
        means = np.stack([np.bincount(stand, column) / count for column in columns], axis=1)
        return means.reshape(len(count), *values.shape[1:])

    return table.kind.averaged(table, first, mean)


def rows_a_stand(table: Table) -> Integers:
    """How many rows each stand of a table has, (s,); none of a circle, which is driven."""
    first = _begins(table)
    return np.empty(0, dtype=np.int64) if first is None else np.bincount(np.cumsum(first) - 1)


def _begins(table: Table) -> Mask | None:
    """Which rows (n,) begin a stand; None where no row is a second reading of one."""
    differs = table.kind.differs(table) if len(table.q) else None
    if differs is None:
        return None
    moved = (np.abs(np.diff(table.q, axis=0)) > STANDS_RAD).any(axis=1) | differs
    return np.concatenate([[True], moved])
