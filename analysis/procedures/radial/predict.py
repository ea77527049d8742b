"""Prediction of the radial test."""

from __future__ import annotations

from analysis.procedures.shared.stop_predictions import TargetPrediction
from analysis.runs.tables import RadialTable


class RadialPrediction(TargetPrediction[RadialTable]):
    """Prediction of the radial test."""


PART = RadialPrediction
