"""Planned runs as a diagnosis would use them: simulated, with the noise of real cells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from analysis.diagnosis.blocks import Block, blocks_of
from analysis.diagnosis.observed_run import ObservedRun, observe_run
from analysis.diagnosis.run_scatter import DRIFTING_SHARE
from analysis.model.predict import SetUp, model_of, nominal_setup
from analysis.noise.cell import BALL_MM, JOINT_DEG, SLOW_MM, TARGET_MM, WHITE_MM
from analysis.simulation.simulate import simulate
from analysis.traces.tables import CircleTable, Table
from rigs.rig import Rig
from rigs.schema.vocabulary import CIRCLES, TestName

_SET_BY_HAND_MM = (0.6, -0.4, 0.1)
"""Displacement of the ball from the circle's centre where the rig file does not define one. Chosen: a ball set by hand
is off by about 0.7 mm, and effects that scale the readings are visible only if these vary."""
ASSUMED_UM = {
    "gauges, white": 1e3 * WHITE_MM.rms,
    "along a lap, slow": 1e3 * SLOW_MM.rms,
    "the ball, from run to run": 1e3 * BALL_MM.rms,
    "a target, from stop to stop": 1e3 * TARGET_MM.rms,
}
"""The noise that planned runs are assumed to have, rms in µm of one run, from the ranges of real cells
(`analysis.noise.cell`)."""
ASSUMED_JOINT_DEG = JOINT_DEG.rms
"""The scatter of each joint between runs that is assumed for planned runs, from the range of real cells."""


def planned_blocks(
    rig: Rig, tests: Sequence[TestName], runs: int, place: str = ""
) -> tuple[list[Block], dict[str, SetUp]]:
    """Return the blocks, with entries (N,), of some tests driven `runs` times in each direction, and their set-ups;
    `place` distinguishes these set-ups from those of other runs. Raises FileError where the arm cannot drive a test."""
    model = model_of(rig)
    seen = [_at(observe_run(model, table, rig.name), place) for table in _tables(rig, tests)]
    setups = {run.one.setup: _setup(rig, run.one.table) for run in seen}
    return [_repeated(block, runs) for block in blocks_of(seen, setups)], setups


def _at(run: ObservedRun, place: str) -> ObservedRun:
    return replace(run, one=replace(run.one, setup=run.one.setup + place))


def _repeated(block: Block, runs: int) -> Block:
    """Return the block of `runs` repeats. Its noise is assumed, because visits simulated without noise do not determine
    it."""
    drifting = np.sqrt(DRIFTING_SHARE) * np.linalg.norm(block.scatter_mm, axis=1)
    sd = block.sd_mm if block.sampling else np.hypot(TARGET_MM.rms, drifting)
    few = 1 / np.sqrt(runs)
    return replace(
        block, sd_mm=few * sd, scatter_mm=few * block.scatter_mm, stamps_mm=few * block.stamps_mm, count=runs,
        measured=False,
    )  # fmt: skip


def _tables(rig: Rig, tests: Sequence[TestName]) -> list[Table]:
    """Return the tables of the driven tests, whose readings are not used. Yaw and roll share one motion, and a cw
    program drives the joint angles of the acw program in reverse."""
    tables = [simulate(rig, test, None, None) for test in tests if test not in CIRCLES]
    if "yaw" in tests or "roll" in tests:
        acw = simulate(rig, "yaw", "acw", None)
        assert isinstance(acw, CircleTable)  # noqa: S101 - what simulate makes of a circle
        cw = replace(acw, direction="cw", t_s=acw.t_s[-1] - acw.t_s[::-1], q=acw.q[::-1])
        tables += [acw, cw] if "yaw" in tests else []
        tables += [replace(lap, test="roll") for lap in (acw, cw)] if "roll" in tests else []
    return tables


def _setup(rig: Rig, table: Table) -> SetUp:
    setup = nominal_setup(rig, table)
    if isinstance(table, CircleTable) and rig.tests.circle:
        off_mm = rig.tests.circle.eccentricity_mm
        return replace(setup, ball=setup.ball + np.array(off_mm if any(off_mm) else _SET_BY_HAND_MM))
    return setup
