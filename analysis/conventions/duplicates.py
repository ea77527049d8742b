"""Places and rows that were written more than once: an instrument that sent its last place again, a file put together
twice."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from analysis.conventions.finding import Finding
from analysis.conventions.path_places import places_of
from analysis.kinematics.arm import arm_of, forward
from analysis.traces.tables import PathTable, PoseTable, Table
from rigs.rig import Rig
from rigs.text import listed

DUPLICATES = "duplicates"
_ELSEWHERE_MM = 1.0
"""A flange that moved so far took the target with it, unless that lies on the axis of the turn."""
_FINE_MM = 2e-3
"""Places of so fine a step differ from visit to visit: robots repeat to 0.01 mm."""
_SEVERAL = 3
"""So many rows with six equal angles and the same place to the last digit are no accident."""


def duplicate_findings(table: Table, rig: Rig) -> Iterator[Finding]:
    """Which rows of poses repeat the place of others."""
    if not isinstance(table, PoseTable) or not len(table.q):
        return
    lost = (table.xyz_mm == 0).all(axis=1)
    places = forward(arm_of(rig.robot), table.q)[:, :3, 3]
    group_of_row = np.unique(table.xyz_mm, axis=0, return_inverse=True)[1].reshape(-1)
    copied = 0
    for group in np.flatnonzero(np.bincount(group_of_row) > 1).tolist():
        alike = (group_of_row == group) & ~lost
        if not alike.any():
            continue
        if np.linalg.norm(places[alike] - places[alike][0], axis=1).max() > _ELSEWHERE_MM:
            what = (
                f"rows {listed(table.rows[alike].tolist())} have the same place to the last digit, though the robot "
                "was elsewhere: the instrument may have sent its last place again"
            )
            remedy = "remove those that it did not measure"
            yield Finding(DUPLICATES, "likely", ("x_mm", "y_mm", "z_mm"), "a place sent again", what, remedy)
        elif (table.q[alike] == table.q[alike][0]).all():
            copied += int(alike.sum()) - 1
    if copied >= _SEVERAL and _step_mm(table) < _FINE_MM:
        what = f"{copied} rows repeat the angles and the place of an earlier one to the last digit, as no visit does"
        yield Finding(DUPLICATES, "likely", (), "rows written twice", what, "remove the copies")


def repeated_places(table: Table, rig: Rig) -> Iterator[Finding]:
    """Which places of a path repeat the one before though the tool went on."""
    del rig
    if isinstance(table, PathTable) and "repeated" in (words := places_of(table).words):
        remedy = "an analysis leaves them out; have the instrument write no place while it has none"
        yield Finding(DUPLICATES, "likely", ("x_mm", "y_mm", "z_mm"), "a place sent again", words["repeated"], remedy)


def _step_mm(table: PoseTable) -> float:
    """The smallest difference of two x, mm: how finely places are written."""
    apart = np.diff(np.unique(table.xyz_mm[:, 0]))
    return float(apart.min()) if len(apart) else 1.0
