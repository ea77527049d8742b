"""Readings so far from all others that no robot explains them, and those that only look so."""

from __future__ import annotations

from collections.abc import Iterator

from analysis.conventions.finding import Finding
from analysis.traces.tables import PoseTable, Table
from rigs.rig import Rig
from rigs.text import listed

WILDNESS = "wildness"


def wild_findings(table: Table, rig: Rig) -> Iterator[Finding]:
    """Which rows of poses have the place of an instrument that lost its target. Those that are wild beside an arm are
    counted where an arm is fitted, by `analysis.conventions.lost_poses`."""
    del rig
    if not isinstance(table, PoseTable):
        return
    lost = (table.xyz_mm == 0).all(axis=1)
    if lost.any():
        rows = listed(table.rows[lost].tolist())
        have = "row {} has the place" if lost.sum() == 1 else "rows {} have the place"
        what = f"{have.format(rows)} 0, 0, 0, as a tracker writes that lost its target"
        remedy = "an analysis leaves it out" if lost.sum() == 1 else "an analysis leaves them out"
        yield Finding(WILDNESS, "likely", ("x_mm", "y_mm", "z_mm"), "no measurement", what, remedy)
