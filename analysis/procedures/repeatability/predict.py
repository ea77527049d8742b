"""Prediction of the repeatability test."""

from __future__ import annotations

import numpy as np

from analysis.procedures.shared.stop_predictions import TargetPrediction
from analysis.robot.geometry.driven_programs import displace_tool, hemisphere_of, repeatability_of
from analysis.robot.geometry.hemisphere import hemisphere_frame, target_angles
from analysis.robot.model.predict import Model, Path, stops
from analysis.runs.tables import RepeatabilityTable


class RepeatabilityPrediction(TargetPrediction[RepeatabilityTable]):
    """Prediction of the repeatability test."""

    def path(self, model: Model, table: RepeatabilityTable) -> Path:
        """Return stops at targets, from outside, from inside, or from the target itself if unknown."""
        hemisphere = hemisphere_of(model.rig)
        polar, azimuth = (angles[table.target - 1] for angles in target_angles(hemisphere))
        side = np.select([table.approach == "out", table.approach == "in"], [1.0, -1.0], 0.0)
        away = (side * repeatability_of(model.rig).approach_mm)[:, None]
        came_from = displace_tool(model.arm, table.q, away * hemisphere_frame(hemisphere).direction(polar, azimuth))
        return stops(table.q, table.t_s, came_from)


PART = RepeatabilityPrediction
