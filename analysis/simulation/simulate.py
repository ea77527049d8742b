"""Simulated measurements: a program driven by a robot with effects, read with noise, as tables."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analysis.kinematics.arm import Array
from analysis.measures.link_angle import planted_setup
from analysis.measures.simulated_gauges import Noise, Simulation
from analysis.model.predict import model_of, nominal_setup, path_of, predict
from analysis.traces.kind import kind_named
from analysis.traces.tables import CircleTable, RadialTable, Table
from rigs.effects import Effect
from rigs.rig import Rig
from rigs.schema.vocabulary import CIRCLES, Direction, TestName


def simulate(
    rig: Rig,
    test: TestName,
    direction: Direction | None,
    seed: int | None,
    effects: Sequence[Effect] | None = None,
    noise: Noise | None = None,
) -> Table:
    """One run of a test, as it would be measured; `seed` None for no noise at all.

    effects: instead of those of the rig file. Poses and paths are those of ISO 9283. Raises FileError where the robot
    cannot do the test.
    """
    return kind_named(test).simulated(rig, direction, Simulation(seed, effects, noise))


def readings_along(rig: Rig, test: TestName, t_s: Array, q: Array) -> Array:
    """Noise-free readings (n, k) mm at every moment t_s (n,) of a motion q (n, 6), for the emulated cell."""
    model = model_of(rig)
    if test in CIRCLES:
        circle = CircleTable(test, "acw", t_s, q, np.empty((0, 2)))
        return predict(model, circle, path_of(model, circle), planted_setup(rig))
    nothing, none = np.zeros(len(q)), np.zeros(len(q), dtype=np.int64)
    targets = RadialTable(none, nothing, nothing, none, t_s, q, nothing)
    return predict(model, targets, path_of(model, targets), nominal_setup(rig, targets))
