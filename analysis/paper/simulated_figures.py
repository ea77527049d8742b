"""The runs and curves behind the paper's figures, simulated and then evaluated like any others."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analysis.api import Result, evaluate
from analysis.kinematics.arm import Array
from analysis.measures.simulated_gauges import Noise
from analysis.paper.published import datum_and_play, gears
from analysis.paper.rows import DIRECTIONS, eccentric
from analysis.paper.simulated_tests import SCATTER, joint_lap, repeats, typical_seed
from analysis.simulation.simulate import simulate
from analysis.traces.csv_tables import columns_of
from analysis.traces.loading import measured_of
from daq.store import table_run
from rigs.effects import Effect
from rigs.rig import Rig
from rigs.schema.vocabulary import Direction, TestName


@dataclass(frozen=True)
class JointLap:
    """The reported joint angles on one lap: phi_deg (n,), q_deg (n, 6), and the names of the axes."""

    phi_deg: Array
    q_deg: Array
    names: tuple[str, ...]


@dataclass(frozen=True)
class SimulatedFigures:
    """Evaluated runs by figure: yaw 3, 5, 6; eccentric 4; joints 7; yaw_datum_and_play 8; roll 10, 11; sphere 13;
    sphere_gears 14; repeatability 15. Free of noise but the last."""

    yaw: dict[Direction, Result]
    eccentric: Result
    joints: JointLap
    yaw_datum_and_play: dict[Direction, Result]
    roll: dict[Direction, Result]
    sphere: Result
    sphere_gears: Result
    repeatability: Result


def figures_of(rig: Rig, rig_text: str) -> SimulatedFigures:
    """Simulate every run. Raises FileError where the robot cannot do a test."""

    def both(test: TestName, effects: Sequence[Effect]) -> dict[Direction, Result]:
        return {direction: _result(rig, rig_text, test, direction, effects) for direction in DIRECTIONS}

    seed = typical_seed(repeats(rig, rig.effects))
    phi, q = joint_lap(rig)
    return SimulatedFigures(
        yaw=both("yaw", rig.effects),
        eccentric=_result(eccentric(rig), rig_text, "yaw", "acw", ()),
        joints=JointLap(np.degrees(phi), np.degrees(q), tuple(axis.name for axis in rig.robot.axes)),
        yaw_datum_and_play=both("yaw", datum_and_play(rig.effects)),
        roll=both("roll", rig.effects),
        sphere=_result(rig, rig_text, "radial", None, rig.effects),
        sphere_gears=_result(rig, rig_text, "radial", None, gears(rig.effects)),
        repeatability=_result(rig, rig_text, "repeatability", None, rig.effects, seed, SCATTER),
    )


def _result(
    rig: Rig,
    rig_text: str,
    test: TestName,
    direction: Direction | None,
    effects: Sequence[Effect],
    seed: int | None = None,
    noise: Noise | None = None,
) -> Result:
    """One simulated run, evaluated."""
    run = table_run(
        Path(f"{test}-{direction}"),
        columns_of(simulate(rig, test, direction, seed, effects, noise)),
        test=test,
        direction=direction,
        rig_name=rig.name,
        rig_text=rig_text,
        operator="rig paper",
        source="simulated",
        source_sha256=hashlib.sha256(repr(effects).encode()).hexdigest(),
    )
    return evaluate(measured_of(run))
