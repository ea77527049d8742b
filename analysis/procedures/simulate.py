"""Simulate measurements: a program driven by a robot with effects, read with noise, as tables and as runs."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path

from analysis.procedures.shared.test_kind import Noise, Simulation, kind_of
from analysis.runs.loading import SIMULATED, Measured, measured_of, rig_of
from analysis.runs.table_format import columns_of
from analysis.runs.tables import Table
from daq.store import table_run
from rigs.effects import Effect
from rigs.readiness import require_test
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
    """Simulate a run of a test; `seed` None for no noise.

    effects: in place of those of the rig file. Poses and paths are those of ISO 9283. Raises FileError if the robot
    cannot do the test.
    """
    require_test(rig, test)
    return kind_of(test).simulated(rig, direction, Simulation(seed, effects, noise))


def noise_seed(seed: int, direction: Direction | None) -> int:
    """Noise seed of a run, different for each direction."""
    return 2 * seed + (direction == "cw")


def simulated_run(
    rig: Rig,
    rig_text: str,
    test: TestName,
    direction: Direction | None,
    seed: int | None,
    effects: Sequence[Effect] | None = None,
    noise: Noise | None = None,
) -> Measured:
    """A simulated run like a measured one, named after test, direction and seed. Raises FileError.

    seed: of the noise, different in both directions; None for no noise. effects: in place of those of the rig. The run
    contains the rig file, without the simulated effects; its source states the seed.
    """
    draw = None if seed is None else noise_seed(seed, direction)
    run = table_run(
        Path("-".join(filter(None, [test, direction, "exact" if seed is None else f"{seed:03d}"]))),
        columns_of(simulate(rig, test, direction, draw, effects, noise)),
        test=test,
        direction=direction,
        rig_name=rig.name,
        rig_text=rig_text,
        operator="rig simulate",
        source=f"{SIMULATED}{'no noise' if seed is None else f'seed {seed}'}",
        source_sha256=hashlib.sha256(repr(effects or rig.effects).encode()).hexdigest(),
    )
    return measured_of(run, rig_of(run).calibrated_as(rig))
