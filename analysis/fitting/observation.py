"""Observations: tables in the form that a fit uses, with the readings to explain and the residuals of a model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.kinematics.arm import Array, Integers
from analysis.measures.rig_agreement import hold_targets
from analysis.model.predict import Model, Path, SetUp, moved, path_of, read
from analysis.model.scene import Scene
from analysis.traces.laps import laps_of
from analysis.traces.tables import CircleTable, PoseTable, RadialTable, RepeatabilityTable, Table, test_of


@dataclass(frozen=True)
class Observation:
    """One table to explain. `rows` (m,) are those of the readings used, `values` (m, k) mm the readings. Observations
    with equal names of their set-up share it."""

    table: Table
    path: Path
    rows: Integers
    values: Array
    setup: str

    @property
    def samples(self) -> Integers:
        """The samples (m,) of the path at which the readings were taken."""
        found: Integers = self.path.rows[self.rows]
        return found

    @property
    def t_s(self) -> Array:
        """The times (m,) s of the readings."""
        found: Array = self.path.t_s[self.samples]
        return found


def observe(model: Model, table: Table, where: str) -> Observation:
    """Return a table with its path and, for a circle, its lap; values are (m, k) mm. Raises FileError for a table that
    is not a circle of the rig."""
    if isinstance(table, CircleTable):
        rows = np.searchsorted(table.t_s, laps_of(table, model.rig, where).t_s)
        return Observation(table, path_of(model, table), rows, table.g_mm[rows], test_of(table))
    rows = np.arange(len(table.q))
    if isinstance(table, RadialTable | RepeatabilityTable):
        hold_targets(table, model.rig, where)
    values = table.xyz_mm if isinstance(table, PoseTable) else table.g_mm[:, None]
    return Observation(table, path_of(model, table), rows, values, test_of(table))


def with_placement(one: Observation, placement: str) -> Observation:
    """Return the observation with the set-up of a placement that the user named; without a name, that of the test
    alone."""
    return replace(one, setup=f"{one.setup} at {placement}") if placement else one


def thinned(one: Observation, most: int) -> Observation:
    """Return a circle with at most `most` (m,) of its readings, evenly spaced, which alone are simulated."""
    kept = np.argsort(one.rows)[:: -(-len(one.rows) // most)]
    path = replace(one.path, rows=one.samples[kept], alone=True)
    return replace(one, path=path, rows=np.arange(len(kept)), values=one.values[kept])


def predicted(model: Model, one: Observation, setup: SetUp) -> Array:
    """Return the readings (m, k) mm that a model predicts; for poses the positions."""
    return predicted_in_scene(model, one, moved(model, one.path), setup)


def predicted_in_scene(model: Model, one: Observation, scene: Scene, setup: SetUp) -> Array:
    """Return the predicted readings (m, k) mm from an existing scene, which is the same for all set-ups."""
    values = read(model, one.table, one.path, scene, setup)
    if isinstance(one.table, PoseTable):
        values = values[:, [3, 7, 11]]
    return values[one.rows]


def residuals_of(model: Model, observations: Sequence[Observation], setups: Mapping[str, SetUp]) -> list[Array]:
    """Return measured minus predicted readings, (m, k) mm for each observation."""
    return [one.values - predicted(model, one, setups[one.setup]) for one in observations]


def rms(residuals: Sequence[Array]) -> float:
    """Return the root mean square in mm of residuals (m, k) mm: per reading of a gauge, and per distance of a
    position."""
    squares = np.concatenate([(r**2).sum(axis=1) if r.shape[1] == 3 else (r**2).ravel() for r in residuals])
    return float(np.sqrt(squares.mean()))
