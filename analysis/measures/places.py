"""Tests whose readings are places, three coordinates of a posture each: what poses and touches have in common."""

from __future__ import annotations

from typing import TypeVar

import numpy as np

from analysis.kinematics.arm import Array
from analysis.model.predict import Model, Path, SetUp, stops
from analysis.model.scene import Scene
from analysis.traces.kind import Kind
from analysis.traces.tables import PlaceTable
from rigs.rig import Rig

P = TypeVar("P", bound=PlaceTable)


class PlaceKind(Kind[P]):
    """A test of places."""

    of_places = True

    def readings(self, table: P) -> Array:
        return table.xyz_mm

    def setup(self, rig: Rig) -> SetUp:
        return SetUp(np.zeros(3), np.zeros(1), np.eye(4), np.eye(4))

    def path(self, model: Model, table: P) -> Path:
        return stops(table.q)

    def read(self, model: Model, table: P, path: Path, scene: Scene, setup: SetUp) -> Array:
        """The target's T_instrument_target, (m, 16) row by row."""
        T = setup.T_instrument_world @ scene.T[path.rows] @ setup.T_tool_target
        return T.reshape(-1, 16)
