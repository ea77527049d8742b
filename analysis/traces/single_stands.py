"""Several readings of one stand of the robot as one: only a visit after a move shows repeatability.

Readings at one stand scatter by the instrument alone. Taken for visits, three of them gave an RP of 0.008 mm, and made
the fits of a calibration, and what is held out of them, three times the same.
"""

from __future__ import annotations

import numpy as np

from analysis.kinematics.arm import Array, Integers, Mask
from analysis.traces.tables import CircleTable, PathTable, PoseTable, RadialTable, RepeatabilityTable, Table, TouchTable

_STANDS_RAD = float(np.radians(0.01))
"""Joints that differ by less stood between two rows; an encoder's noise is a tenth of it (`analysis.traces.stands`)."""
_STANDS_MM = 1.0
"""Places or readings of one stand that differ by more are no readings of one thing; they are left as they are."""


def one_row_a_stand(table: Table) -> Table:
    """A table with neighbouring rows of one stand averaged; circles, driven, as they are."""
    if isinstance(table, CircleTable | TouchTable | PathTable) or not len(
        table.q
    ):  # a ball that is seated again is a touch
        return table
    first = _begins(table)
    stand = np.cumsum(first) - 1
    return table if first.all() else _averaged(table, first, stand)


def rows_a_stand(table: Table) -> Integers:
    """How many rows each stand of a table has, (s,); none of a circle, which is driven."""
    if isinstance(table, CircleTable | TouchTable | PathTable) or not len(table.q):
        return np.empty(0, dtype=np.int64)
    return np.bincount(np.cumsum(_begins(table)) - 1)


def _begins(table: PoseTable | RadialTable | RepeatabilityTable) -> Mask:
    """Which rows (n,) begin a stand."""
    moved = (np.abs(np.diff(table.q, axis=0)) > _STANDS_RAD).any(axis=1) | _differ(table)
    return np.concatenate([[True], moved])


def _differ(table: PoseTable | RadialTable | RepeatabilityTable) -> Mask:
    """Which rows (n - 1,) are something else than the row before, whatever the joints."""
    match table:
        case PoseTable():
            lost = (table.xyz_mm == 0).all(axis=1)
            far = np.linalg.norm(np.diff(table.xyz_mm, axis=0), axis=1) > _STANDS_MM
            return np.asarray(far | lost[1:] | lost[:-1])
        case RadialTable():
            labels = np.stack([table.target, table.orientation], axis=1)
        case RepeatabilityTable():
            side = np.unique(table.approach, return_inverse=True)[1]
            labels = np.stack([table.target, side, table.round], axis=1)
    return np.asarray((np.diff(labels, axis=0) != 0).any(axis=1) | (np.abs(np.diff(table.g_mm)) > _STANDS_MM))


def _averaged(
    table: PoseTable | RadialTable | RepeatabilityTable, first: Mask, stand: Integers
) -> PoseTable | RadialTable | RepeatabilityTable:
    """The table with a row for each stand; first (n,): whether a row begins one, stand (n,): its number from 0."""
    count = np.bincount(stand)

    def mean(values: Array) -> Array:
        """Means (s, …) in the values' unit over each stand."""
        columns = values.reshape(len(values), -1).T
        means = np.stack([np.bincount(stand, column) / count for column in columns], axis=1)
        return means.reshape(len(count), *values.shape[1:])

    if isinstance(table, PoseTable):
        rpy = None if table.rpy is None else _mean_turns(table.rpy, first, stand)
        return PoseTable(mean(table.q), mean(table.xyz_mm), rpy, table.rows[first], table.rail)
    target, t_s, q, g_mm = table.target[first], mean(table.t_s), mean(table.q), mean(table.g_mm)
    if isinstance(table, RepeatabilityTable):
        return RepeatabilityTable(target, table.approach[first], table.round[first], t_s, q, g_mm)
    polar, azimuth = table.polar[first], table.azimuth[first]
    return RadialTable(target, polar, azimuth, table.orientation[first], t_s, q, g_mm)


def _mean_turns(rpy: Array, first: Mask, stand: Integers) -> Array:
    """Mean turns (s, 3) rad over each stand of rpy (n, 3) rad."""
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - slow to import, needed here only

    means = rpy[first].copy()
    for number in np.flatnonzero(np.bincount(stand) > 1).tolist():
        means[number] = Rotation.from_euler("xyz", rpy[stand == number]).mean().as_euler("xyz")
    return means
