"""Runs simulated in memory, and intermediate results of the engine, for tests of the diagnosis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from analysis.apps.planning.capability import CapabilityOfTests, plan
from analysis.diagnosis.diagnose import diagnose
from analysis.diagnosis.evidence.blocks import blocks_of
from analysis.diagnosis.evidence.observation import ObservedRun, observe_run
from analysis.diagnosis.evidence.setups import fit_run_setups
from analysis.diagnosis.fit.background import Background, background_of
from analysis.diagnosis.fit.candidates import Columns, Form, candidates_for, columns_for
from analysis.diagnosis.fit.responses import Linearisation, linearise, noise_um
from analysis.diagnosis.judge.result import Diagnosis
from analysis.procedures.shared.test_kind import nominal_setup, path_of
from analysis.procedures.simulate import simulate
from analysis.robot.kinematics.arm import arm_of, forward
from analysis.robot.predict import SetUp, model_of, moved
from analysis.runs.loading import Measured
from analysis.runs.tables import CircleTable, PoseTable, Table
from daq.store import Run
from daq.store.manifest import Manifest
from rigs.effects import Backlash, Effect, JointOffset, TransmissionError
from rigs.load import load, load_hidden
from rigs.rig import Rig
from rigs.schema.limits import Limits
from rigs.schema.vocabulary import Direction, TestName
from tests.support.made_once import made_once

Array = NDArray[np.float64]
RIG, TEXT = load("paper-fanuc")
LIMITS = RIG.limits
# Limits are omitted: computing unused figures would take a quarter of the time of each diagnosis.
RIG = load_hidden("paper-fanuc").apply_to(RIG).model_copy(update={"effects": (), "limits": Limits()})
WAYS: tuple[Direction, ...] = ("cw", "acw")


@cache
def table_of(test: TestName, direction: Direction | None, seed: int | None, effects: tuple[Effect, ...] = ()) -> Table:
    """Simulate a run of the robot of the paper; seed None disables the noise."""
    return simulate(RIG, test, direction, seed, effects)


def measured(table: Table, test: TestName, name: str, rig: Rig = RIG) -> Measured:
    """Return a table as a run read from a directory."""
    direction = table.direction if isinstance(table, CircleTable) else None
    told: dict[str, Any] = {"name": name, "test": test, "direction": direction, "rig_text": TEXT}
    manifest = Manifest.model_construct(**told)
    return Measured(Path(name), Run(Path(name), manifest, {}, []), rig, table, 0.0, ())


def poses(seed: int, *off: JointOffset) -> Measured:
    """Simulate random poses measured by a tracker with an unknown frame and 40 µm noise."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(-1.0, 1.0, (100, 6))
    true = q.copy()
    for one in off:
        true[:, one.axis - 1] += np.radians(one.offset_deg)
    xyz = forward(arm_of(RIG.robot), true)[:, :3, 3] + [100.0, -40.0, 10.0] + rng.normal(0.0, 0.04, (100, 3))
    return measured(PoseTable(q, xyz, None), "pose", "pose")


def circles(
    effects: tuple[Effect, ...] = (),
    *,
    seed: int = 1,
    count: int = 2,
    tests: Sequence[TestName] = ("yaw",),
    ways: Sequence[Direction] = WAYS,
) -> list[Measured]:
    """Simulate repeated circles, each run with a different seed."""
    return [
        measured(table_of(test, way, 1000 * seed + 100 * k + 10 * j + i, effects), test, f"{test}-{way}-{i}")
        for k, test in enumerate(tests)
        for j, way in enumerate(ways)
        for i in range(count)
    ]


def remounted_circles(effect: Effect, *more: Effect, seed: int = 1) -> tuple[list[Measured], Array]:
    """Simulate a yaw circle in each direction after the ball was moved to the tool position changed by a large effect.

    Returns the runs and the displacement (3,) mm of the ball. The additional effects do not move the circle.
    """
    table = table_of("yaw", "cw", None)
    scenes = [moved(model, path_of(model, table)) for model in (model_of(RIG, ()), model_of(RIG, (effect,)))]
    shift: Array = np.mean(scenes[1].T[:, :3, 3] - scenes[0].T[:, :3, 3], axis=0)
    assert RIG.tests.circle
    there = tuple(np.array(RIG.tests.circle.eccentricity_mm) + shift)
    circle = RIG.tests.circle.model_copy(update={"eccentricity_mm": there})
    rig = RIG.model_copy(update={"tests": RIG.tests.model_copy(update={"circle": circle})})
    runs = [(way, simulate(rig, "yaw", way, 10 * seed + k, (effect, *more))) for k, way in enumerate(WAYS)]
    return [measured(one, "yaw", f"yaw-{way}") for way, one in runs], shift


def response(run: Measured, frequency_hz: float, amplitude_mm: float, phase: float) -> Measured:
    """Simulate a circle with a vibrating link; phase in rad."""
    table = run.table
    assert isinstance(table, CircleTable)
    wave = amplitude_mm * np.sin(2 * np.pi * frequency_hz * table.t_s + phase)
    return replace(run, table=replace(table, g_mm=table.g_mm + wave[:, None]))


def found_in(
    runs: Sequence[Measured],
    rig: Rig = RIG,
    held_out: Sequence[Measured] = (),
    unseen: Sequence[Measured] = (),
) -> Diagnosis:
    return diagnose(rig, runs, held_out, unseen, lambda doing: None)


@made_once
def plan_of_circles() -> CapabilityOfTests:
    """Return the capability of a yaw and a roll circle of the robot of the paper for all effects."""
    return plan(RIG, ("yaw", "roll"))


@made_once
def plan_without_further_tests() -> CapabilityOfTests:
    """Return the capability of a yaw circle only, without comparing further tests, which takes most of the time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("analysis.apps.planning.capability.possible_tests", lambda *_, **__: ([], []))
        return plan(RIG, ("yaw",))


ZERO = JointOffset(axis=3, offset_deg=0.05)
GEAR = TransmissionError(axis=4, order=8, amplitude_deg=0.03, phase_deg=40)
PLAY = Backlash(axis=5, width_deg=0.03)
DEMO = (PLAY, GEAR, ZERO)
"""Hidden effects of the demo."""
assert RIG.tests.circle
_X, _Y, _Z = RIG.tests.circle.centre_mm
_CIRCLE = RIG.tests.circle.model_copy(update={"centre_mm": (_X + 60, _Y, _Z - 60)})
ELSEWHERE = RIG.model_copy(update={"tests": RIG.tests.model_copy(update={"circle": _CIRCLE})})


def there(effects: tuple[Effect, ...]) -> list[Measured]:
    """Simulate laps in each direction at a different place."""
    return [
        measured(simulate(ELSEWHERE, "yaw", way, 77 + k, effects), "yaw", f"else-{way}-0", ELSEWHERE)
        for k, way in enumerate(WAYS)
    ]


@made_once
def demo() -> Diagnosis:
    """Diagnose a lap in each direction of the demo cell, validated at a different place."""
    return found_in(circles(DEMO, count=1), unseen=there(DEMO))


def seen(runs: Sequence[Measured]) -> list[ObservedRun]:
    """Convert runs to the input of the engine."""
    return [observe_run(model_of(RIG), run.table, str(run.path)) for run in runs]


def planted() -> SetUp:
    """Return the true set-up of simulated circles of the robot of the paper: eccentric ball, gauge zeros at 0."""
    setup = nominal_setup(RIG, table_of("yaw", "cw", 0))
    assert RIG.tests.circle
    return replace(setup, ball=setup.ball + np.array(RIG.tests.circle.eccentricity_mm))


@cache
def healthy() -> Linearisation:
    """Return the linearisation of two yaw circles in each direction of a healthy robot, at the fitted set-up."""
    runs = seen(circles(seed=90))
    setups, _ = fit_run_setups(runs)
    return linearise(blocks_of(runs, setups), setups)


@cache
def healthy_columns() -> Columns:
    return columns_for(healthy(), candidates_for(healthy()))


def holding(linear: Linearisation, y: Array) -> Linearisation:
    """Return the linearisation with a different residual (N,) in standard deviations."""
    parts = [y[rows] * block.sd_mm for rows, block in zip(linear.rows, linear.blocks, strict=True)]
    blocks = [replace(block, y_mm=part) for block, part in zip(linear.blocks, parts, strict=True)]
    return linearise(blocks, linear.setups)


def shown_by(linear: Linearisation, effects: Sequence[Effect]) -> Array:
    """Return the change (N,) of the residual, in standard deviations, caused by all these effects together in the
    simulator.
    """
    return np.concatenate(
        [block.white(added) for block, added in zip(linear.blocks, linear.responses(effects), strict=True)]
    )


def white(linear: Linearisation, seed: int) -> Array:
    """Noise (N,) of standard deviation 1."""
    return np.random.default_rng(seed).normal(0.0, 1.0, len(linear.y))


def columns_of(X: Array, band: NDArray[np.int64], forms: Sequence[Form] = ()) -> Columns:
    """Return columns (N, p) with given values: first those of forms, then those of set-ups."""
    ends = sum(len(form.columns) for form in forms)
    nothing = np.zeros(X.shape[1])
    return Columns(X, tuple(forms), slice(ends, X.shape[1]), band, nothing, nothing, nothing)


def no_background(linear: Linearisation, more: Array | None = None) -> Background:
    """Return a background of noise and set-ups only, with `more` (N, p) additional columns of standard deviation 1."""
    other = np.empty((len(linear.y), 0)) if more is None else more
    X = np.concatenate([linear.U, other], axis=1)
    variance = np.concatenate([np.full(linear.U.shape[1], 100.0), np.ones(other.shape[1])])
    return background_of(columns_of(X, np.zeros(len(X), dtype=np.int64)), np.ones(len(X)), variance)


def scatter_um(linear: Linearisation) -> Array:
    """Return the noise (b,) µm of a run without the part that timestamps add."""
    blocks = [replace(block, apart_mm=block.steady_mm) for block in linear.blocks]
    return noise_um(linearise(blocks, linear.setups))
