from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.evidence.blocks import blocks_of
from analysis.diagnosis.evidence.observation import predicted
from analysis.diagnosis.evidence.setups import fit_run_setups
from analysis.diagnosis.fit.responses import Linearisation, linearise
from analysis.procedures.shared.test_kind import facts_of
from analysis.robot.predict import SetUp
from rigs.effects import Backlash, Effect, GaugeCyclic, JointOffset, LinkGeometry, ReversalSpike, TransmissionError
from tests.support.diagnosis_cells import Array, healthy, holding, planted, poses, remounted_circles, seen, table_of

SMALL = (
    LinkGeometry(axis=4, field="d", delta=0.02),
    Backlash(axis=1, width_deg=0.01),
    TransmissionError(axis=4, order=3, amplitude_deg=0.005, phase_deg=40),
    ReversalSpike(axis=2, amplitude_deg=0.005, decay_s=0.3),
    GaugeCyclic(gauge="g1", amplitude_mm=0.002, period_mm=0.5),
)


def _simulated(linear: Linearisation, effects: tuple[Effect, ...]) -> Array:
    parts = []
    for block in linear.blocks:
        table = block.table
        plain, grown = (table_of("yaw", table.direction, None, which) for which in ((), effects))
        parts.append(block.whitened((grown.g_mm - plain.g_mm)[block.rows]))
    return np.concatenate(parts)


@pytest.mark.parametrize("effect", SMALL, ids=lambda effect: effect.effect)
def test_a_column_is_the_difference_of_two_simulations(effect):
    linear = healthy()
    column = linear.without_set_up(linear.columns([effect])[:, 0])
    wanted = linear.without_set_up(_simulated(linear, (effect,)))
    assert np.linalg.norm(wanted) > 1
    assert np.linalg.norm(column - wanted) < 0.02 * np.linalg.norm(wanted)


def left_at(linear: Linearisation, effects: Sequence[Effect], setups: Mapping[str, SetUp]) -> Array:
    added = zip(linear.blocks, linear.responses(effects, setups), strict=True)
    left: Array = linear.y - np.concatenate([block.white(one) for block, one in added])
    return left


def test_ball_and_zero_explain_their_own_error_completely():
    linear = healthy()
    assert linear.U.shape[1] == facts_of(linear.blocks[0].table.test).setup_terms == 5
    for term, moved in enumerate(0.02 * np.eye(5)):
        there = linear.responses((), linear.setups_moved_by(moved))
        shift = np.concatenate([block.white(added) for block, added in zip(linear.blocks, there, strict=True)])
        assert np.linalg.norm(linear.without_set_up(shift)) < 5e-3 * max(np.linalg.norm(shift), 1.0), term


def test_terms_of_poses_are_place_and_rotation_of_the_instrument_and_its_target():
    runs = seen([poses(1)])
    setups, _ = fit_run_setups(runs)
    linear = linearise(blocks_of(runs, setups), setups)
    there = linear.setups_moved_by(np.arange(1.0, 10.0))["pose"]
    before = setups["pose"]
    np.testing.assert_allclose(there.T_instrument_world[:3, 3] - before.T_instrument_world[:3, 3], [1, 2, 3])
    np.testing.assert_allclose(there.T_tool_target[:3, 3] - before.T_tool_target[:3, 3], [7, 8, 9])
    turned = there.T_instrument_world[:3, :3] @ before.T_instrument_world[:3, :3].T
    assert np.arccos((np.trace(turned) - 1) / 2) == pytest.approx(np.linalg.norm([0.04, 0.05, 0.06]))


def test_the_residual_is_exact_for_large_effects_and_moved_set_ups():
    linear, effects = healthy(), (JointOffset(axis=3, offset_deg=1.0), Backlash(axis=2, width_deg=0.5))
    parts = []
    for block in linear.blocks:
        table = block.table
        grown = table_of("yaw", table.direction, None, effects)
        base = predicted(block, linear.setups["yaw"])
        parts.append(block.whitened(grown.g_mm[block.rows] - base))
    there = holding(linear, np.concatenate(parts))
    whole = np.linalg.norm(np.concatenate(parts))
    assert np.linalg.norm(left_at(there, effects, {"yaw": planted()})) < 1e-3 * whole
    assert np.linalg.norm(left_at(there, effects[:1], {"yaw": planted()})) > 1e-2 * whole
    off = replace(planted(), zeros_mm=np.array([0.1, 0.0]))
    assert np.linalg.norm(left_at(there, effects, {"yaw": off})) > 10


@pytest.mark.parametrize(
    "effect", [JointOffset(axis=3, offset_deg=1.0), LinkGeometry(axis=3, field="a", delta=20.0)], ids=["zero", "length"]
)
def test_a_large_effect_moves_the_set_up_on_the_simulator(effect):
    """A zero wrong by a degree, or a length by a centimetre, moves the tool by as much and the ball that was set up for
    it, over which readings are not linear: the set-up goes with the tool, and is followed in steps."""
    measured, shift = remounted_circles(effect, seed=91)
    runs = seen(measured)
    setups, _ = fit_run_setups(runs)
    assert np.linalg.norm(shift) > 10
    linear = linearise(blocks_of(runs, setups), setups)
    both = linear.residual([effect]), left_at(linear, [effect], setups)
    left, still = (float(np.sqrt(np.mean(linear.without_set_up(one) ** 2))) for one in both)
    assert left < 0.5  # single runs, whose noise is assumed wide
    assert still > 5 * left
