"""Checks of a table of tracker poses."""

from __future__ import annotations

from collections.abc import Iterator

from analysis.procedures.checks.checks_of_test import Checks, Finders, PathDeviation, Verdict
from analysis.procedures.checks.finding import Finding
from analysis.procedures.checks.lost_poses import DUPLICATES, WILDNESS, duplicate_findings, outlier_findings
from analysis.procedures.checks.meanings import FEWEST, judged_by_places
from analysis.procedures.checks.place import SOURCE, source_findings
from analysis.procedures.checks.units import UNITS, impossible, mirror_findings, off_in_its_unit, rail_findings, tracker
from analysis.robot.kinematics.arm import Array
from analysis.runs.tables import PoseTable
from rigs.rig import Rig


class PoseChecks(Checks[PoseTable]):
    """Evidence in tracker poses."""

    @property
    def finders(self) -> Finders[PoseTable]:
        return ((SOURCE, source_findings), (WILDNESS, outlier_findings), (DUPLICATES, duplicate_findings))

    def unit_findings(self, table: PoseTable, rig: Rig, T_tool: Array) -> Iterator[Finding]:
        yield from rail_findings(table, rig)
        yield from mirror_findings(table, rig, UNITS)
        yield from impossible(tracker(table, T_tool))

    def cannot_tell(self, table: PoseTable, rig: Rig) -> str:
        sound = int((table.xyz_mm != 0).any(axis=1).sum())
        return "" if sound >= FEWEST else f"{sound} poses are too few; {FEWEST} are needed"

    def judged_joints(self, table: PoseTable, rig: Rig) -> Verdict:
        return judged_by_places(rig, table.q, table.xyz_mm, table.rpy)

    def off_path(self, table: PoseTable, rig: Rig, T_tool: Array) -> PathDeviation | None:
        return off_in_its_unit(T_tool, table.xyz_mm)


PART = PoseChecks
