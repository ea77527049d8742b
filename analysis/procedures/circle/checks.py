"""Checks of the table of a circle."""

from __future__ import annotations

from collections.abc import Iterable

from analysis.procedures.checks.checks_of_test import Checks, Finders, PathDeviation, Verdict
from analysis.procedures.checks.finding import Finding
from analysis.procedures.checks.gauge_sign import ORDER, order_findings
from analysis.procedures.checks.meanings import PLACE_UNKNOWN, judged_by_path
from analysis.procedures.checks.place import STAMPS, off_circle, stamp_findings
from analysis.procedures.checks.units import circle_gauges, impossible
from analysis.robot.kinematics.arm import Array
from analysis.runs.tables import CircleTable
from rigs.rig import Rig


class CircleChecks(Checks[CircleTable]):
    """Evidence in the table of a circle."""

    @property
    def finders(self) -> Finders[CircleTable]:
        """Return the checks of the times, and for yaw of the order of the gauges, which an eccentric ball reveals."""
        of_order: Finders[CircleTable] = ((ORDER, order_findings),) if self.test == "yaw" else ()
        return ((STAMPS, stamp_findings), *of_order)

    def unit_findings(self, table: CircleTable, rig: Rig, T_tool: Array) -> Iterable[Finding]:
        return impossible(circle_gauges(table, rig, T_tool))

    def cannot_tell(self, table: CircleTable, rig: Rig) -> str:
        return "" if rig.tests.circle else PLACE_UNKNOWN

    def judged_joints(self, table: CircleTable, rig: Rig) -> Verdict:
        return judged_by_path(table, rig)

    def off_path(self, table: CircleTable, rig: Rig, T_tool: Array) -> PathDeviation | None:
        return off_circle(T_tool, rig.tests.circle) if rig.tests.circle else None


PART = CircleChecks
