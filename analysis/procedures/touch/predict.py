"""Prediction of touches."""

from __future__ import annotations

from analysis.procedures.shared.stop_predictions import PlacePrediction
from analysis.robot.model.predict import SetUp
from analysis.runs.tables import TouchTable
from rigs.rig import Rig


class TouchPrediction(PlacePrediction[TouchTable]):
    """Prediction of touches."""

    def setup(self, rig: Rig) -> SetUp:
        setup = super().setup(rig)
        if rig.tests.touch:
            setup.T_tool_target[:3, 3] = rig.tests.touch.ball_mm
        return setup


PART = TouchPrediction
