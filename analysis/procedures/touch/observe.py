"""Observation of an arm by touches."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from analysis.procedures.checks.lost_poses import Outliers, far_touches
from analysis.procedures.shared.observations import UsualObservation
from analysis.procedures.touch.evaluate import evaluate, known_otherwise
from analysis.robot.kinematics.arm import Arm, forward
from analysis.robot.model.predict import Model
from analysis.runs.tables import TouchTable
from rigs.errors import FileError


class TouchObservation(UsualObservation[TouchTable]):
    """Observation of an arm by touches; each socket has a separate set-up."""

    def parts(self, table: TouchTable) -> NDArray[np.str_]:
        return table.socket

    def outliers(self, table: TouchTable, arm: Arm) -> Outliers:
        return far_touches(table, forward(arm, table.q))

    def doubts(self, table: TouchTable, model: Model, where: str) -> tuple[str, ...]:
        """Return notes about socket distances that differ from the stated ones. A few touches do not determine the
        positions.
        """
        declared = model.rig.tests.touch
        if declared is None or not declared.distances:
            return ()
        try:
            return known_otherwise(evaluate(table, model, where).distances)
        except FileError:
            return ()


PART = TouchObservation
