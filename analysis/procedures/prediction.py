"""Predicted readings of a table: its set-up, its motion and its readings, as its test asks for them."""

from __future__ import annotations

from analysis.robot.kinematics.arm import Array
from analysis.robot.model.predict import Model, Path, SetUp, moved
from analysis.robot.model.scene import Scene
from analysis.runs.tables import Table
from rigs.rig import Rig


def nominal_setup(rig: Rig, table: Table) -> SetUp:
    """Ball in the nominal centre, gauges at zero, instrument in the world's frame."""
    return table.kind.setup(rig)


def path_of(model: Model, table: Table) -> Path:
    """The motion behind a table: as recorded, or with the approaches that the test prescribes."""
    return table.kind.path(model, table)


def predict(model: Model, table: Table, path: Path, setup: SetUp) -> Array:
    """Readings (m, k) of a table: gauges in mm; for poses the target's T_instrument_target, (m, 16) row by row."""
    return read(model, table, path, moved(model, path), setup)


def read(model: Model, table: Table, path: Path, scene: Scene, setup: SetUp) -> Array:
    """Readings (m, k) as `predict` gives them, in mm, from a scene that was computed before: nothing that a set-up
    changes moves the tool."""
    return table.kind.read(model, table, path, scene, setup)
