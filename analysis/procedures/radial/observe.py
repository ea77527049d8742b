"""Observation of an arm by the radial test."""

from __future__ import annotations

import numpy as np

from analysis.procedures.shared.observations import TargetObservation
from analysis.robot.kinematics.arm import Integers
from analysis.runs.tables import RadialTable


class RadialObservation(TargetObservation[RadialTable]):
    """Observation of an arm by the radial test."""

    def visits(self, table: RadialTable) -> Integers:
        return np.stack([table.target, table.orientation], axis=1)


PART = RadialObservation
