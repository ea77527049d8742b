"""Prediction of tracker poses."""

from __future__ import annotations

from analysis.procedures.shared.stop_predictions import PlacePrediction
from analysis.runs.tables import PoseTable


class PosePrediction(PlacePrediction[PoseTable]):
    """Prediction of tracker poses."""


PART = PosePrediction
