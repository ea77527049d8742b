"""Runs not yet driven, as a diagnosis would see them: simulated, with noise as wide as real cells have it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from analysis.diagnosis.blocks import Block, blocks_of
from analysis.diagnosis.noise import WANDERING
from analysis.diagnosis.observed import Seen, see
from analysis.model.predict import SetUp, model_of, nominal_setup
from analysis.noise.cell import BALL_MM, JOINT_DEG, SLOW_MM, TARGET_MM, WHITE_MM
from analysis.simulation.simulate import simulate
from analysis.traces.tables import CircleTable, Table
from rigs.rig import Rig
from rigs.schema.vocabulary import CIRCLES, TestName

_SET_BY_HAND_MM = (0.6, -0.4, 0.1)
"""Off the circle's centre, where the rig file does not say: no ball is set exactly, and what scales the readings shows
only where they move."""
ASSUMED_UM = {
    "gauges, white": 1e3 * WHITE_MM.rms,
    "along a lap, slow": 1e3 * SLOW_MM.rms,
    "the ball, from run to run": 1e3 * BALL_MM.rms,
    "a target, from stop to stop": 1e3 * TARGET_MM.rms,
}
"""The noise that planned runs are taken to have, rms in µm of one run."""
ASSUMED_JOINT_DEG = JOINT_DEG.rms
"""How far each joint lies off from run to run, in planned runs."""


def planned(rig: Rig, tests: Sequence[TestName], runs: int, place: str = "") -> tuple[list[Block], dict[str, SetUp]]:
    """Blocks of some tests, each driven `runs` times in each direction, and their set-ups; place: what tells these
    set-ups from those of other runs beside them. Raises FileError where the arm cannot do a test."""
    model = model_of(rig)
    seen = [_at(see(model, table, rig.name), place) for table in _tables(rig, tests)]
    setups = {run.one.setup: _setup(rig, run.one.table) for run in seen}
    return [_repeated(block, runs) for block in blocks_of(seen, setups)], setups


def _at(run: Seen, place: str) -> Seen:
    return replace(run, one=replace(run.one, setup=run.one.setup + place))


def _repeated(block: Block, runs: int) -> Block:
    """The block of as many runs. Its noise is assumed: visits simulated without noise do not show how noisy real ones
    are."""
    wandering = np.sqrt(WANDERING) * np.linalg.norm(block.scatter_mm, axis=1)
    sd = block.sd_mm if block.sampling else np.hypot(TARGET_MM.rms, wandering)
    few = 1 / np.sqrt(runs)
    return replace(block, sd_mm=few * sd, scatter_mm=few * block.scatter_mm, count=runs, measured=False)


def _tables(rig: Rig, tests: Sequence[TestName]) -> list[Table]:
    """The tests as driven; their readings do not matter, nothing is measured yet. Yaw and roll are one motion, and a cw
    program drives the joint angles of the acw one back."""
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
