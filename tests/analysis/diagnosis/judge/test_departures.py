"""Deviations of a real effect from its model: harmonics of a gear, form of a spike, start within a backlash, delays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.evidence.blocks import Block, blocks_of
from analysis.diagnosis.evidence.observation import ORDER_OF, ORDER_OF_TREND
from analysis.diagnosis.evidence.setups import fit_run_setups
from analysis.diagnosis.fit.departures import departure_columns, fewest_columns, initial_play_columns, similar_columns
from analysis.diagnosis.fit.responses import linearise
from analysis.robot.model.predict import turns
from analysis.runs.loading import Measured
from analysis.runs.tables import CircleTable
from rigs.effects import (
    Backlash,
    BallForm,
    Effect,
    GaugeCyclic,
    JointOffset,
    ReversalSpike,
    ThermalGrowth,
    TimeLag,
    TransmissionError,
)
from rigs.schema.effect import SPECTRUM_SHARE
from rigs.schema.scene import play
from tests.support.diagnosis_cells import Array, circles, healthy, measured, seen, table_of

LATE = 3
"""Columns of a joint's effect that comes at another time: stamps may be late, or ever later, or scatter."""
GEAR = TransmissionError(axis=1, order=20, amplitude_deg=0.02, phase_deg=30)


def test_an_offset_has_one_form_only() -> None:
    assert departure_columns(healthy(), JointOffset(axis=3, offset_deg=0.1)).shape == (len(healthy().y), 0)


def test_a_gear_has_its_second_and_third_harmonic_in_any_phase() -> None:
    linear = healthy()
    found = departure_columns(linear, GEAR)
    assert found.shape[1] == 4 + LATE
    for order in (40.0, 60.0):
        harmonic = linear.columns([GEAR.model_copy(update={"order": order, "phase_deg": 75.0})])[:, 0]
        weights, *_ = np.linalg.lstsq(found, harmonic, rcond=None)
        assert np.linalg.norm(harmonic - found @ weights) < 0.02 * np.linalg.norm(harmonic)
        assert 2 < np.linalg.norm(weights[:4]) < 20
    odd = linear.columns([GEAR.model_copy(update={"order": 33.0})])[:, 0]
    weights, *_ = np.linalg.lstsq(found, odd, rcond=None)
    assert np.linalg.norm(odd - found @ weights) > 0.5 * np.linalg.norm(odd)


@pytest.mark.parametrize(
    ("effect", "count"),
    [
        (GEAR, 4 + LATE),
        (GaugeCyclic(gauge="g1", period_mm=1.0, amplitude_mm=0.01), 2),
        (BallForm(lobes=3, amplitude_mm=0.01), 4),
        (BallForm(lobes=2, amplitude_mm=0.01), 2),
    ],
)
def test_forms_grow_with_the_effect(effect: TransmissionError | GaugeCyclic | BallForm, count: int) -> None:
    size = "amplitude_deg" if isinstance(effect, TransmissionError) else "amplitude_mm"
    half = effect.model_copy(update={size: getattr(effect, size) / 2})
    once, twice = departure_columns(healthy(), half), departure_columns(healthy(), effect)
    assert twice.shape[1] == count
    np.testing.assert_allclose(twice, 2 * once, atol=1e-3 * np.abs(twice).max())


def test_a_spike_may_come_a_sample_sooner_or_later_at_every_turn() -> None:
    linear = healthy()
    spike = ReversalSpike(axis=2, amplitude_deg=0.02, decay_s=0.2)
    turned = sum(len(turns(block.path.t_s, block.path.q[:, 1])) for block in linear.blocks)
    found = departure_columns(linear, spike)
    assert turned >= 4 and found.shape[1] >= 2 * turned
    other = departure_columns(linear, spike.model_copy(update={"amplitude_deg": -0.04}))
    np.testing.assert_allclose(np.abs(other), 2 * np.abs(found), atol=1e-9)


def _leaves(found: Array, wanted: Array) -> float:
    """How much of what is wanted the columns cannot show, as a share."""
    weights, *_ = np.linalg.lstsq(found, wanted, rcond=None)
    return float(np.linalg.norm(wanted - found @ weights) / np.linalg.norm(wanted))


def test_a_play_may_have_wider_and_narrower_ones_in_place_of_a_part_of_it() -> None:
    linear = healthy()
    sharp = Backlash(axis=1, width_deg=0.05)
    found = similar_columns(linear, sharp)
    whole, narrower, wider, none = linear.columns(
        [sharp.model_copy(update={"width_deg": width}) for width in (0.05, 0.025, 0.2)]
        + [TransmissionError(axis=1, order=33, amplitude_deg=0.02)]
    ).T
    assert max(_leaves(found, 2 * narrower - whole), _leaves(found, wider / 4 - whole)) < 1e-6
    assert min(_leaves(found, narrower), _leaves(found, none)) > 0.5  # the height of the play is its own


def test_growth_may_come_faster_and_slower_in_part() -> None:
    linear = healthy()
    growth = ThermalGrowth(ppm=300, time_constant_s=100)
    found = similar_columns(linear, growth)
    whole, fast, slow = linear.columns(
        [growth.model_copy(update={"time_constant_s": tau_s}) for tau_s in (100.0, 20.0, 200.0)]
    ).T
    assert max(_leaves(found, fast - whole), _leaves(found, slow - whole)) < 1e-6
    assert np.linalg.norm(found[:, 0]) == pytest.approx(SPECTRUM_SHARE * np.linalg.norm(fast - whole))


@pytest.mark.parametrize("effect", [Backlash(axis=1, width_deg=0.1), GEAR])
def test_a_play_and_a_gear_have_columns_of_their_lateness(effect: Effect) -> None:
    found = departure_columns(healthy(), effect)
    assert _leaves(found, healthy().retimed(effect)[:, 0]) < 1e-6


@pytest.mark.parametrize("effect", [Backlash(axis=1, width_deg=0.1), GEAR])
def test_an_effect_of_a_joint_may_come_later_as_everything_does_by_late_stamps(effect: Effect) -> None:
    linear, late = healthy(), TimeLag(lag_s=0.001)
    together, alone, stamps, none = (linear.residual(each) for each in ([effect, late], [effect], [late], []))
    beyond = together - alone - stamps + none
    found = linear.retimed(effect)[:, :-1]
    assert found.shape == (len(linear.y), 2) and np.linalg.norm(beyond) > 10  # the test shows something
    # Late stamps turn the link too, and with it the direction in which the error shows.
    assert _leaves(found, beyond) < 0.2
    weights, *_ = np.linalg.lstsq(found, -beyond, rcond=None)
    assert sorted(weights) == pytest.approx([0.0, 1.0], abs=0.02)  # a healthy lag, and no rate


def test_stamps_that_scatter_make_a_quick_wave_smaller() -> None:
    """The mean over many laps of a wave read at instants that scatter, against the column for the scatter."""
    linear, rng = healthy(), np.random.default_rng(7)

    def wave(q: Array) -> Array:
        turned: Array = np.radians(0.02) * np.sin(120 * q)
        return turned

    def lost(block: Block) -> Array:
        t, q = block.path.t_s, block.path.q[:, 0]
        scatter = rng.normal(0.0, np.median(np.diff(t)) / 4, (200, len(t)))
        mean: Array = np.mean([wave(np.interp(t + one, t, q)) for one in scatter], axis=0)
        return (mean - wave(q))[:, None]

    gear = TransmissionError(axis=1, order=120, amplitude_deg=0.02)
    found, wanted = linear.retimed(gear)[:, -1:], linear.by_joint(1, lost)[:, 0]
    (weight,), *_ = np.linalg.lstsq(found, wanted, rcond=None)
    assert np.linalg.norm(wanted) > 10  # the test shows something
    assert weight == pytest.approx(1.0, abs=0.1)
    assert _leaves(departure_columns(linear, gear), found[:, 0]) < 1e-6


def test_at_targets_nothing_comes_later() -> None:
    runs = seen([*circles(seed=91), measured(table_of("repeatability", None, 5), "repeatability", "approaches")])
    setups, _ = fit_run_setups(runs)
    linear = linearise(blocks_of(runs, setups), setups)
    found = linear.retimed(Backlash(axis=2, width_deg=0.1))
    (at_targets,) = [rows for block, rows in zip(linear.blocks, linear.rows, strict=True) if not block.sampling]
    assert found.any() and not found[at_targets].any()


def test_what_is_left_of_a_spike_at_targets_is_unknown_and_on_circles_it_is_not() -> None:
    runs = seen([*circles(seed=91), measured(table_of("repeatability", None, 5), "repeatability", "approaches")])
    setups, _ = fit_run_setups(runs)
    linear = linearise(blocks_of(runs, setups), setups)
    spike = ReversalSpike(axis=2, amplitude_deg=0.02, decay_s=1.0)
    whole, found = linear.columns([spike])[:, 0], departure_columns(linear, spike)
    (at_targets,) = [rows for block, rows in zip(linear.blocks, linear.rows, strict=True) if not block.sampling]
    circle = np.ones(len(whole), dtype=bool)
    circle[at_targets] = False
    assert np.abs(whole[at_targets]).max() > 1  # the test shows something
    assert _leaves(found[at_targets], whole[at_targets]) < 1e-6
    shown = np.abs(found[at_targets]).max(axis=0) > 0
    assert shown.any() and not found[circle][:, shown].any()


def test_a_spike_of_a_joint_that_does_not_turn_back_in_some_circle_has_no_columns_there() -> None:
    run = circles(seed=7, count=1, ways=("cw",))[0]
    table = run.table
    assert isinstance(table, CircleTable)
    kept = table.t_s < 19.2
    short = replace(table, t_s=table.t_s[kept], q=table.q[kept], g_mm=table.g_mm[kept])
    runs = seen([replace(run, table=short)])
    setups, _ = fit_run_setups(runs)
    linear = linearise(blocks_of(runs, setups), setups)
    turning = [axis for axis in range(1, 7) if linear.blocks[0].path.motion.reversals(axis)]
    assert 4 not in turning and len(turning) > 3
    for axis in range(1, 7):
        found = departure_columns(linear, ReversalSpike(axis=axis, amplitude_deg=0.02))
        assert found.shape[1] > 0 if axis in turning else found.shape == (len(linear.y), 0)


def test_a_spike_that_begins_later_is_larger_from_then_on() -> None:
    linear, decay_s = healthy(), 0.5
    spike = ReversalSpike(axis=2, amplitude_deg=0.02, decay_s=decay_s)
    found, whole = departure_columns(linear, spike), linear.columns([spike])[:, 0]
    step_s = float(np.median(np.diff(linear.blocks[0].path.t_s)))
    weights, *_ = np.linalg.lstsq(found, whole, rcond=None)
    assert np.linalg.norm(whole - found @ weights) < 1e-6 * np.linalg.norm(whole)  # each of its turns has the own size
    later = np.abs(weights).max()
    assert 0.2 * step_s < decay_s / later < 0.8 * step_s  # a time of less than a sample


def _standing(run: Measured) -> Measured:
    table = run.table
    assert isinstance(table, CircleTable)
    n = len(table.t_s)
    rows = np.concatenate([np.zeros(50, int), np.arange(n), np.full(50, n - 1)])
    noise = np.random.default_rng(1).normal(0.0, 0.001, (len(rows), 2))
    table = replace(table, t_s=0.02 * np.arange(len(rows)), q=table.q[rows], g_mm=table.g_mm[rows] + noise)
    return replace(run, table=table)


@pytest.mark.parametrize("begin", [-1.0, -0.3, 0.7])
def test_a_run_may_have_begun_anywhere_in_a_play(begin: float) -> None:
    """Until the joint has crossed its play, it stands off by as much; of 0.6 degrees that is a part of the lap."""
    linear, half = healthy(), np.radians(0.3)

    def off(block: Block) -> Array:
        x = block.path.q[:, 1]
        return (play(x, half, begin) - play(x, half))[:, None]

    added = linear.by_joint(2, off)[:, 0]
    found = departure_columns(linear, Backlash(axis=2, width_deg=0.6))
    weights, *_ = np.linalg.lstsq(found, added, rcond=None)
    assert np.linalg.norm(added) > 50
    assert np.linalg.norm(added - found @ weights) < 0.02 * np.linalg.norm(added)
    elsewhere = linear.columns([Backlash(axis=3, width_deg=0.6)])[:, 0]
    weights, *_ = np.linalg.lstsq(found, elsewhere, rcond=None)
    assert np.linalg.norm(elsewhere - found @ weights) > 0.5 * np.linalg.norm(elsewhere)


def test_a_wide_play_may_begin_in_more_places_than_one_of_a_healthy_arm() -> None:
    """What a joint of healthy play begins with is crossed at once: one column for each circle is enough."""
    linear = healthy()
    wide, healthy_play = Backlash(axis=2, width_deg=0.6), Backlash(axis=2, width_deg=0.01)
    assert initial_play_columns(linear, [healthy_play]).shape[1] <= len(linear.blocks)
    assert departure_columns(linear, wide).shape[1] > 10 * len(linear.blocks)


def test_where_a_play_began_shows_while_the_robot_stands_before_its_lap() -> None:
    runs = seen([_standing(run) for run in circles()])
    setups, _ = fit_run_setups(runs)
    linear = linearise(blocks_of(runs, setups), setups)
    assert [len(block.y_mm) for block in linear.blocks] == [len(ORDER_OF) + 4 + len(ORDER_OF_TREND)] * 2
    found = initial_play_columns(linear, [Backlash(axis=2, width_deg=0.1)])
    first = [rows.start + len(ORDER_OF) + np.arange(2) for rows in linear.rows]
    shows = np.array([np.linalg.norm(found[own], axis=0) for own in first])
    assert (np.diag(shows) > 10).all() and shows[0, 1] == shows[1, 0] == 0


def test_readings_of_a_gauge_that_stands_are_no_surer_than_its_step() -> None:
    """All of them are rounded alike: with 10 µm steps their mean is off by up to 5 µm, however many there are."""
    runs = seen([_standing(run) for run in circles()])
    runs = [replace(run, step_mm=0.010) for run in runs]
    for block in blocks_of(runs, fit_run_setups(runs)[0]):
        assert (block.sd_mm[len(ORDER_OF) :][:4] >= 0.010 / np.sqrt(12)).all()


def test_the_fewest_columns_allow_for_the_same() -> None:
    columns = departure_columns(healthy(), Backlash(axis=2, width_deg=0.6))
    fewest = fewest_columns(columns)
    assert fewest.shape[1] < 0.6 * columns.shape[1]
    variance = np.linalg.eigvalsh(columns.T @ columns).max()
    np.testing.assert_allclose(fewest @ fewest.T, columns @ columns.T, atol=1e-6 * variance)
    assert fewest_columns(columns[:, :0]).shape == (len(columns), 0)
