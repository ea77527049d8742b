"""Checks of a table of the repeatability test."""

from __future__ import annotations

from analysis.procedures.shared.target_checks import TargetChecks
from analysis.robot.geometry.hemisphere import target_angles
from analysis.robot.kinematics.arm import Array
from analysis.runs.tables import RepeatabilityTable
from rigs.schema.declared_tests import Hemisphere


class RepeatabilityChecks(TargetChecks[RepeatabilityTable]):
    """Evidence in a table of the repeatability test."""

    def directions(self, table: RepeatabilityTable, hemisphere: Hemisphere) -> tuple[Array, Array] | None:
        """Return the angles (n,) rad of the numbered targets."""
        polar, azimuth = target_angles(hemisphere)
        if table.target.min() < 1 or table.target.max() > len(polar):
            return None
        return polar[table.target - 1], azimuth[table.target - 1]


PART = RepeatabilityChecks
