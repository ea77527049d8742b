"""Checks of a table of the radial test."""

from __future__ import annotations

from analysis.procedures.shared.target_checks import TargetChecks
from analysis.robot.kinematics.arm import Array
from analysis.runs.tables import RadialTable
from rigs.schema.declared_tests import Hemisphere


class RadialChecks(TargetChecks[RadialTable]):
    """Evidence in a table of the radial test."""

    def directions(self, table: RadialTable, hemisphere: Hemisphere) -> tuple[Array, Array]:
        """Return the angles (n,) rad of the table."""
        return table.polar, table.azimuth


PART = RadialChecks
