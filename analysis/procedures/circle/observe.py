"""Observation of an arm by the laps of a circle."""

from __future__ import annotations

import numpy as np

from analysis.procedures.shared.observations import UsualObservation
from analysis.robot.kinematics.arm import Integers
from analysis.runs.laps import laps_of
from analysis.runs.tables import CircleTable
from rigs.rig import Rig


class CircleObservation(UsualObservation[CircleTable]):
    """Observation of an arm by the laps of a circle, without lead-in and lead-out."""

    def rows_used(self, table: CircleTable, rig: Rig, where: str) -> Integers:
        return np.searchsorted(table.t_s, laps_of(table, rig, where).t_s)


PART = CircleObservation
