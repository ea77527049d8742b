"""Observation of an arm by the repeatability test."""

from __future__ import annotations

import numpy as np

from analysis.procedures.shared.observations import TargetObservation
from analysis.robot.kinematics.arm import Integers
from analysis.runs.tables import RepeatabilityTable


class RepeatabilityObservation(TargetObservation[RepeatabilityTable]):
    """Observation of an arm by the repeatability test."""

    def visits(self, table: RepeatabilityTable) -> Integers:
        side = np.select([table.approach == "out", table.approach == "in"], [1, 2], 0)
        return np.stack([table.target, side], axis=1)


PART = RepeatabilityObservation
