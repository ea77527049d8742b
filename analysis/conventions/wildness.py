"""Readings so far from all others that no robot explains them, and those that only look so: poses, touches, paths."""

from __future__ import annotations

from collections.abc import Iterator

from analysis.conventions.finding import Finding
from analysis.conventions.lost_poses import far_poses, far_touches, left_out
from analysis.conventions.path_places import places_of
from analysis.kinematics.arm import arm_of, forward, without_setup
from analysis.traces.tables import PathTable, PoseTable, Table, TouchTable
from rigs.rig import Rig
from rigs.text import listed

WILDNESS = "wildness"


def wild_findings(table: Table, rig: Rig) -> Iterator[Finding]:
    """Which rows of poses have the place of an instrument that lost its target, or lie far from where the arm was
    (`analysis.conventions.lost_poses`)."""
    if isinstance(table, TouchTable):
        far = far_touches(table, forward(arm_of(rig.robot), table.q))
        if far.wild.any():
            what, remedy = left_out(table, far.wild, far.far_mm).rsplit("; ", 1)
            yield Finding(WILDNESS, "likely", ("socket",), "no touch", what, remedy)
        return
    if not isinstance(table, PoseTable):
        return
    lost = (table.xyz_mm == 0).all(axis=1)
    if lost.any():
        rows = listed(table.rows[lost].tolist())
        have = "row {} has the place" if lost.sum() == 1 else "rows {} have the place"
        what = f"{have.format(rows)} 0, 0, 0, as a tracker writes that lost its target"
        remedy = "an analysis leaves it out" if lost.sum() == 1 else "an analysis leaves them out"
        yield Finding(WILDNESS, "likely", ("x_mm", "y_mm", "z_mm"), "no measurement", what, remedy)
    far = far_poses(table, without_setup(arm_of(rig.robot)))
    if (wild := far.wild).any():
        what = left_out(table, wild, far.far_mm)
        what, remedy = what.rsplit("; ", 1)
        yield Finding(WILDNESS, "likely", ("x_mm", "y_mm", "z_mm"), "no measurement", what, remedy)


def wild_places(table: Table, rig: Rig) -> Iterator[Finding]:
    """Which places of a path lie off the path beside them."""
    del rig
    if isinstance(table, PathTable) and "wild" in (words := places_of(table).words):
        remedy = "check that nothing crossed the beam; an analysis leaves them out"
        yield Finding(WILDNESS, "likely", ("x_mm", "y_mm", "z_mm"), "no measurement", words["wild"], remedy)
