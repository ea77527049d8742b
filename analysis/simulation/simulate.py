"""Simulated measurements: a program driven by a robot with effects, read with noise, as tables."""

from __future__ import annotations

from collections.abc import Sequence

from analysis.measures.simulated_gauges import Noise, Simulation
from analysis.traces.kind import kind_named
from analysis.traces.tables import Table
from rigs.effects import Effect
from rigs.rig import Rig
from rigs.schema.vocabulary import Direction, TestName


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
