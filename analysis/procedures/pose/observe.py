"""Observation of an arm by tracker poses."""

from __future__ import annotations

from analysis.procedures.checks.lost_poses import Outliers, far_poses
from analysis.procedures.shared.observations import UsualObservation
from analysis.robot.kinematics.arm import Arm, without_setup
from analysis.runs.tables import PoseTable


class PoseObservation(UsualObservation[PoseTable]):
    """Observation of an arm by tracker poses."""

    def outliers(self, table: PoseTable, arm: Arm) -> Outliers:
        return far_poses(table, without_setup(arm))


PART = PoseObservation
