"""Prediction of the readings of a table: set-up, motion and readings, according to its test.

Each test implements it as `PART` in the module `predict` of its package, unless the test reveals nothing about joints.
"""

from __future__ import annotations

from abc import abstractmethod
from functools import cache
from typing import Protocol, TypeVar

from analysis.procedures.facts import no_joints_error, shows_joints
from analysis.robot.kinematics.arm import Array
from analysis.robot.model.predict import Model, Path, SetUp, moved
from analysis.robot.model.scene import ModelScene
from analysis.runs.parts_of_tests import TestPart, part_of
from analysis.runs.tables import Table
from rigs.rig import Rig
from rigs.schema.vocabulary import TestName

T_contra = TypeVar("T_contra", bound=Table, contravariant=True)


class Prediction(TestPart, Protocol[T_contra]):
    """Prediction of a table by the model of an arm."""

    @abstractmethod
    def setup(self, rig: Rig) -> SetUp:
        """Return the nominal set-up: ball in the nominal centre, gauges at zero, instrument in the world frame."""

    @abstractmethod
    def path(self, model: Model, table: T_contra) -> Path:
        """Return the motion of a table: as recorded, or with the approaches required by the test."""

    @abstractmethod
    def read(self, model: Model, table: T_contra, path: Path, scene: ModelScene, setup: SetUp) -> Array:
        """Return readings (m, k): gauges in mm; for places T_instrument_target, (m, 16) row by row."""


def prediction_of(table: Table) -> Prediction[Table]:
    """Return the prediction of a table. Raises FileError for a test that reveals nothing about joints."""
    return _prediction(table.test)


@cache
def _prediction(test: TestName) -> Prediction[Table]:
    if not shows_joints(test):
        raise no_joints_error(test, f"a {test} table")
    return part_of(test, "predict")


def nominal_setup(rig: Rig, table: Table) -> SetUp:
    """Return the nominal set-up: ball in the nominal centre, gauges at zero, instrument in the world frame."""
    return prediction_of(table).setup(rig)


def path_of(model: Model, table: Table) -> Path:
    """Return the motion of a table: as recorded, or with the approaches required by the test."""
    return prediction_of(table).path(model, table)


def predict(model: Model, table: Table, path: Path, setup: SetUp) -> Array:
    """Predict the readings (m, k) of a table: gauges in mm; for poses T_instrument_target, (m, 16) row by row."""
    return read(model, table, path, moved(model, path), setup)


def read(model: Model, table: Table, path: Path, scene: ModelScene, setup: SetUp) -> Array:
    """Return readings (m, k) mm like `predict` from an existing scene, because a set-up does not change the tool."""
    return prediction_of(table).read(model, table, path, scene, setup)
