"""What an effect does is simulate(model + effect) - simulate(model), what set-ups can do taken out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.evidence.blocks import blocks_of
from analysis.diagnosis.evidence.observation import predicted
from analysis.diagnosis.evidence.setups import fit_run_setups
from analysis.diagnosis.fit.responses import Linearisation, linearise
from analysis.procedures.shared.test_kind import facts_of
from analysis.robot.model.predict import SetUp
from analysis.runs.tables import CircleTable
from rigs.effects import (
    Backlash,
    BallForm,
    Effect,
    GaugeCyclic,
    GaugeDeadBand,
    GaugeScale,
    JointOffset,
    LinkGeometry,
    ReversalSpike,
    ServoLag,
    TransmissionError,
)
from tests.support.diagnosis_cells import (
    RIG,
    Array,
    circles,
    healthy,
    holding,
    planted,
    poses,
    remounted_circles,
    seen,
    table_of,
    white,
)

SMALL = (
    JointOffset(axis=3, offset_deg=0.01),
    LinkGeometry(axis=4, field="d", delta=0.02),
    Backlash(axis=1, width_deg=0.01),
    TransmissionError(axis=4, order=3, amplitude_deg=0.005, phase_deg=40),
    ReversalSpike(axis=2, amplitude_deg=0.005, decay_s=0.3),
    ServoLag(axis=5, lag_s=0.001),
    GaugeScale(gauge="g2", relative=0.001),
    GaugeDeadBand(gauge="g1", width_mm=0.01),
    GaugeCyclic(gauge="g1", amplitude_mm=0.002, period_mm=0.5),
    BallForm(lobes=3, amplitude_mm=0.002),
)


def _simulated(linear: Linearisation, effects: tuple[Effect, ...]) -> Array:
    """Noise-free readings of a robot with effects, less those of a healthy one, by `simulate` alone."""
    parts = []
    for block in linear.blocks:
        table = block.table
        assert isinstance(table, CircleTable)
        plain, grown = (table_of("yaw", table.direction, None, which) for which in ((), effects))
        assert isinstance(plain, CircleTable) and isinstance(grown, CircleTable)
        parts.append(block.whitened((grown.g_mm - plain.g_mm)[block.rows]))
    return np.concatenate(parts)


@pytest.mark.parametrize("effect", SMALL, ids=lambda effect: effect.effect)
def test_a_column_is_the_difference_of_two_simulations(effect: Effect) -> None:
    linear = healthy()
    column = linear.without_set_up(linear.columns([effect])[:, 0])
    wanted = linear.without_set_up(_simulated(linear, (effect,)))
    assert np.linalg.norm(wanted) > 1
    assert np.linalg.norm(column - wanted) < 0.02 * np.linalg.norm(wanted)


def test_columns_of_several_effects_stand_side_by_side() -> None:
    linear = healthy()
    both = linear.columns(SMALL[:2])
    np.testing.assert_allclose(both[:, [1]], linear.columns(SMALL[1:2]))
    assert linear.columns(()).shape == (len(linear.y), 0)


def left_at(linear: Linearisation, effects: Sequence[Effect], setups: Mapping[str, SetUp]) -> Array:
    """The whitened residual with effects in given set-ups."""
    added = zip(linear.blocks, linear.responses(effects, setups), strict=True)
    left: Array = linear.y - np.concatenate([block.white(one) for block, one in added])
    return left


def test_what_a_ball_or_a_zero_can_do_leaves_nothing() -> None:
    linear = healthy()
    assert linear.U.shape[1] == facts_of(linear.blocks[0].table.test).setup_terms == 5
    for term, moved in enumerate(0.02 * np.eye(5)):
        there = linear.responses((), linear.setups_moved_by(moved))
        shift = np.concatenate([block.white(added) for block, added in zip(linear.blocks, there, strict=True)])
        assert np.linalg.norm(linear.without_set_up(shift)) < 5e-3 * max(np.linalg.norm(shift), 1.0), term


def test_terms_of_poses_are_where_an_instrument_stands_its_turn_and_its_target() -> None:
    runs = seen([poses(1)])
    setups, _ = fit_run_setups(runs)
    linear = linearise(blocks_of(runs, setups), setups)
    there = linear.setups_moved_by(np.arange(1.0, 10.0))["pose"]
    before = setups["pose"]
    np.testing.assert_allclose(there.T_instrument_world[:3, 3] - before.T_instrument_world[:3, 3], [1, 2, 3])
    np.testing.assert_allclose(there.T_tool_target[:3, 3] - before.T_tool_target[:3, 3], [7, 8, 9])
    turned = there.T_instrument_world[:3, :3] @ before.T_instrument_world[:3, :3].T
    assert np.arccos((np.trace(turned) - 1) / 2) == pytest.approx(np.linalg.norm([0.04, 0.05, 0.06]))


def test_a_turn_of_axis_1_is_a_shift_of_the_ball() -> None:
    linear = healthy()
    turn = JointOffset(axis=1, offset_deg=0.01)
    assert np.linalg.norm(linear.without_set_up(linear.columns([turn]))) < 0.02 * np.linalg.norm(linear.columns([turn]))


def test_the_residual_is_exact_for_large_effects_and_moved_set_ups() -> None:
    """The residual vanishes for the true effects and set-up, even for large errors and a ball far from its nominal
    place.
    """
    linear, effects = healthy(), (JointOffset(axis=3, offset_deg=1.0), Backlash(axis=2, width_deg=0.5))
    parts = []
    for block in linear.blocks:
        table = block.table
        assert isinstance(table, CircleTable)
        grown = table_of("yaw", table.direction, None, effects)
        assert isinstance(grown, CircleTable)
        base = predicted(block, linear.setups["yaw"])
        parts.append(block.whitened(grown.g_mm[block.rows] - base))
    there = holding(linear, np.concatenate(parts))
    whole = np.linalg.norm(np.concatenate(parts))
    assert np.linalg.norm(left_at(there, effects, {"yaw": planted()})) < 1e-3 * whole
    assert np.linalg.norm(left_at(there, effects[:1], {"yaw": planted()})) > 1e-2 * whole
    off = replace(planted(), zeros_mm=np.array([0.1, 0.0]))
    assert np.linalg.norm(left_at(there, effects, {"yaw": off})) > 10


def test_nothing_named_leaves_the_residual() -> None:
    linear = healthy()
    y = white(linear, 1)
    # What noise moves the set-up by shows in second order.
    np.testing.assert_allclose(holding(linear, y).residual(()), y, atol=1e-3)
    np.testing.assert_allclose(left_at(holding(linear, y), (), linear.setups), y, atol=1e-9)


@pytest.mark.parametrize(
    "effect", [JointOffset(axis=3, offset_deg=1.0), LinkGeometry(axis=3, field="a", delta=20.0)], ids=["zero", "length"]
)
def test_a_large_effect_moves_the_set_up_on_the_simulator(effect: Effect) -> None:
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


@pytest.mark.parametrize("effect", [JointOffset(axis=2, offset_deg=1.5), JointOffset(axis=3, offset_deg=1.0)], ids=str)
def test_a_large_effect_is_followed_where_the_ball_stayed_behind(effect: Effect) -> None:
    runs = seen(circles((effect,), seed=93, count=1))
    linear = linearise(blocks_of(runs, fit_run_setups(runs)[0]), fit_run_setups(runs)[0])
    assert float(np.sqrt(np.mean(linear.without_set_up(linear.residual([effect])) ** 2))) < 0.5


def test_placements_of_poses_are_moved_with_one_tool() -> None:
    """Two placements of an instrument, and a zero that is wrong by half a degree: the same tool in both."""
    zero = JointOffset(axis=3, offset_deg=0.5)
    runs = seen([poses(1, zero), poses(2, zero)])
    runs = [replace(run, setup=f"pose at {name}") for run, name in zip(runs, "AB", strict=True)]
    setups, _ = fit_run_setups(runs)
    linear = linearise(blocks_of(runs, setups), setups)
    left = linear.residual([zero])
    assert np.mean(linear.without_set_up(left) ** 2) == pytest.approx(1.0, abs=0.1)
    moved = linear.setups_moved_by(linear.moves_with([zero]))
    tools = [moved[name].T_tool_target for name in ("pose at A", "pose at B")]
    np.testing.assert_allclose(*tools)
    assert np.mean(left_at(linear, [zero], moved) ** 2) < 2  # the last step, below 0.05 mm, is not taken


def test_a_set_up_is_fitted_from_two_centimetres_away() -> None:
    runs = seen(circles(seed=92))
    far = replace(planted(), ball=planted().ball + np.array([16.0, -8.0, 9.0]))
    away = fit_run_setups(runs, {"yaw": far})[0]["yaw"].ball - planted().ball
    assert RIG.tests.circle
    normal = np.array(RIG.tests.circle.normal, dtype=float)
    assert np.linalg.norm(np.cross(away, normal / np.linalg.norm(normal))) < 0.01


def test_the_column_of_a_length_is_its_slope_whatever_its_size() -> None:
    """The ball of a column does not move with the tool, so that it is eccentric by as much as a length is wrong."""
    lengths = [LinkGeometry(axis=2, field="a", delta=delta) for delta in (0.2, 20.0)]
    small, large = healthy().columns(lengths).T
    np.testing.assert_allclose(large, 100 * small, atol=1e-9 * np.abs(large).max())


def test_jolts_at_every_sample_are_an_offset() -> None:
    linear, angle = healthy(), 0.002
    whole = np.zeros(len(linear.y))
    block = linear.blocks[1]
    for sample in block.path.rows[block.rows]:
        whole += linear.jolt(1, 3, int(sample), angle)
    first = len(linear.blocks[0].y_mm)
    assert not whole[:first].any()
    offset = linear.columns([JointOffset(axis=3, offset_deg=angle)])[first:, 0]
    assert np.linalg.norm(whole[first:] - offset) < 1e-3 * np.linalg.norm(offset)


def test_what_hardly_shows_of_a_set_up_is_not_moved() -> None:
    """A ball along the normal of its circle: the readings hardly change, so an error of theirs would move it far."""
    linear = healthy()
    assert RIG.tests.circle
    normal = np.array(RIG.tests.circle.normal) / np.linalg.norm(RIG.tests.circle.normal)
    along, across = np.array([*normal, 0.0, 0.0]), np.array([*np.roll(normal, 1), 0.0, 0.0])
    moves = holding(linear, linear.U @ (5.0 * along + 0.2 * across)).moves_with(())
    assert abs(moves[:3] @ normal) < 0.1
    np.testing.assert_allclose(moves - (moves[:3] @ normal) * along, 0.2 * across, atol=0.05)
