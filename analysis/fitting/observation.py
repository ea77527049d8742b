"""Tables as a fit sees them: which readings are to be explained, and what a model leaves of them."""

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
    """One table to explain. rows (m,): which readings count; values (m, k) mm; a set-up is shared by its name."""

    table: Table
    path: Path
    rows: Integers
    values: Array
    setup: str


def observe(model: Model, table: Table, where: str) -> Observation:
    """A table with its path, and its lap where it is a circle. Raises FileError for a circle that is none."""
    if isinstance(table, CircleTable):
        rows = np.searchsorted(table.t_s, laps_of(table, model.rig, where).t_s)
        return Observation(table, path_of(model, table), rows, table.g_mm[rows], test_of(table))
    rows = np.arange(len(table.q))
    if isinstance(table, RadialTable | RepeatabilityTable):
        hold_targets(table, model.rig, where)
    values = table.xyz_mm if isinstance(table, PoseTable) else table.g_mm[:, None]
    return Observation(table, path_of(model, table), rows, values, test_of(table))


def with_placement(one: Observation, placement: str) -> Observation:
    """The same with the set-up of a placement that a person named; without a name, of the test alone."""
    return replace(one, setup=f"{one.setup} at {placement}") if placement else one


def predicted(model: Model, one: Observation, setup: SetUp) -> Array:
    """What a model says the observed readings are, (m, k) mm; of poses the places."""
    return seen(model, one, moved(model, one.path), setup)


def seen(model: Model, one: Observation, scene: Scene, setup: SetUp) -> Array:
    """The same from a scene that is there already: one for all set-ups."""
    values = read(model, one.table, one.path, scene, setup)
    if isinstance(one.table, PoseTable):
        values = values[:, [3, 7, 11]]
    return values[one.rows]


def residuals_of(model: Model, observations: Sequence[Observation], setups: Mapping[str, SetUp]) -> list[Array]:
    """Measured less predicted, (m, k) mm for each observation."""
    return [one.values - predicted(model, one, setups[one.setup]) for one in observations]


def rms(residuals: Sequence[Array]) -> float:
    """Root mean square of residuals (m, k) mm: per reading of a gauge, per distance of a place."""
    squares = np.concatenate([(r**2).sum(axis=1) if r.shape[1] == 3 else (r**2).ravel() for r in residuals])
    return float(np.sqrt(squares.mean()))
