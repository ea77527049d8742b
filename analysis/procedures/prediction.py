"""Predicted readings of a table: its set-up, its motion and its readings, as its test asks for them."""

from __future__ import annotations

from analysis.robot.kinematics.arm import Array
from analysis.robot.model.predict import Model, Path, SetUp, moved
from analysis.robot.model.scene import Scene
from analysis.runs.tables import Table
from rigs.rig import Rig


def nominal_setup(rig: Rig, table: Table) -> SetUp:
    """Return the nominal set-up: ball in the nominal centre, gauges at zero, instrument in the world frame."""
    return table.kind.setup(rig)


def path_of(model: Model, table: Table) -> Path:
    """Return the motion of a table: as recorded, or with the approaches required by the test."""
    return table.kind.path(model, table)


def predict(model: Model, table: Table, path: Path, setup: SetUp) -> Array:
    """Predict the readings (m, k) of a table: gauges in mm; for poses T_instrument_target, (m, 16) row by row."""
    return read(model, table, path, moved(model, path), setup)


def read(model: Model, table: Table, path: Path, scene: Scene, setup: SetUp) -> Array:
    """Return readings (m, k) mm like `predict` from an existing scene, because a set-up does not change the tool."""
    return table.kind.read(model, table, path, scene, setup)
