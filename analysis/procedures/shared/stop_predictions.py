"""Common predictions of tests with stops: one gauge at hemisphere targets, or positions of postures."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import numpy as np

from analysis.procedures.prediction import Prediction
from analysis.robot.geometry.driven_programs import hemisphere_of
from analysis.robot.geometry.hemisphere import hemisphere_frame
from analysis.robot.kinematics.arm import Array
from analysis.robot.model.predict import Model, Path, SetUp, gauged, stops, visits
from analysis.robot.model.scene import ModelScene, apply
from analysis.runs.tables import PlaceTable, TargetTable
from rigs.rig import Rig

H = TypeVar("H", bound=TargetTable)
P = TypeVar("P", bound=PlaceTable)


class TargetPrediction(Prediction[H]):
    """Prediction of a test at targets."""

    def setup(self, rig: Rig) -> SetUp:
        return SetUp(np.array(hemisphere_of(rig).centre_mm), np.zeros(1), np.eye(4), np.eye(4))

    def path(self, model: Model, table: H) -> Path:
        return stops(table.q, table.t_s)

    def read(self, model: Model, table: H, path: Path, scene: ModelScene, setup: SetUp) -> Array:
        """Return the reading of the gauge (m, 1) mm: distance between ball and tool less the radius."""
        to_tool = scene.T[:, :3, 3] - setup.ball
        sphere = hemisphere_frame(hemisphere_of(model.rig))
        contact = np.arctan2(to_tool @ sphere.v, to_tool @ sphere.u)
        scene = apply(model.effects, "setup", replace(scene, contact=contact))
        g_mm = (np.linalg.norm(to_tool, axis=1) - sphere.radius + scene.form_mm)[:, None]
        return gauged(model, path, scene, setup, g_mm)


class PlacePrediction(Prediction[P]):
    """Prediction of a test of positions."""

    def setup(self, rig: Rig) -> SetUp:
        return SetUp(np.zeros(3), np.zeros(1), np.eye(4), np.eye(4))

    def path(self, model: Model, table: P) -> Path:
        return visits(table.q, table.came_from)

    def read(self, model: Model, table: P, path: Path, scene: ModelScene, setup: SetUp) -> Array:
        """Return T_instrument_target of the target, (m, 16) row by row."""
        # Both products are linear in the pose; a single matrix takes a third of the time of products pose by pose.
        both = np.multiply.outer(setup.T_instrument_world, setup.T_tool_target).transpose(1, 2, 0, 3).reshape(16, 16)
        return np.asarray(path.at_readings(scene.T).reshape(-1, 16) @ both)
