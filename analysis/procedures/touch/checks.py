"""Checks of a table of touches."""

from __future__ import annotations

from analysis.procedures.checks.checks_of_test import Checks, Finders, PathDeviation, Verdict
from analysis.procedures.checks.lost_poses import WILDNESS, outlying_touches
from analysis.procedures.checks.meanings import FEWEST, judged_by_sockets
from analysis.procedures.checks.place import off_sockets
from analysis.robot.kinematics.arm import Array
from analysis.runs.tables import TouchTable
from rigs.rig import Rig


class TouchChecks(Checks[TouchTable]):
    """Evidence in touches."""

    @property
    def finders(self) -> Finders[TouchTable]:
        return ((WILDNESS, outlying_touches),)

    def cannot_tell(self, table: TouchTable, rig: Rig) -> str:
        return "" if len(table.q) >= FEWEST else f"{len(table.q)} touches are too few; {FEWEST} are needed"

    def judged_joints(self, table: TouchTable, rig: Rig) -> Verdict:
        return judged_by_sockets(table, rig)

    def off_path(self, table: TouchTable, rig: Rig, T_tool: Array) -> PathDeviation | None:
        return off_sockets(T_tool, table.socket)


PART = TouchChecks
