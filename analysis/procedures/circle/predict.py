"""Prediction of the readings on a circle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analysis.procedures.prediction import Prediction
from analysis.robot.geometry.circle import frame_of, link_readings
from analysis.robot.geometry.driven_programs import circle_of
from analysis.robot.kinematics.arm import Array
from analysis.robot.model.motion import Motion
from analysis.robot.model.predict import Model, Path, SetUp, gauged
from analysis.robot.model.scene import ModelScene, apply
from analysis.runs.tables import CircleTable
from rigs.rig import Rig


class CirclePrediction(Prediction[CircleTable]):
    """Prediction of both gauges on a circle."""

    def setup(self, rig: Rig) -> SetUp:
        return SetUp(np.array(circle_of(rig).centre_mm), np.zeros(2), np.eye(4), np.eye(4))

    def path(self, model: Model, table: CircleTable) -> Path:
        return Path(Motion(table.t_s, table.q), np.arange(len(table.q)))

    def read(self, model: Model, table: CircleTable, path: Path, scene: ModelScene, setup: SetUp) -> Array:
        """Return the readings of both gauges (m, 2) mm."""
        to_tool = scene.T[:, :3, 3] - setup.ball
        circle = frame_of(circle_of(model.rig))
        offsets = np.array([gauge.offset_mm for _, gauge in model.rig.gauges])
        contact = np.arctan2(to_tool @ circle.v, to_tool @ circle.u)
        scene = apply(model.effects, "setup", replace(scene, contact=contact, offsets_mm=offsets))
        g_mm = link_readings(scene.T, setup.ball, scene.offsets_mm, table.test, circle.radius, scene.form_mm)
        return gauged(model, path, scene, setup, g_mm)


PART = CirclePrediction
