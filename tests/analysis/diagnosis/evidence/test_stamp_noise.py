"""Stamps that scatter make a few angles of a lap noisy where a joint crosses a play, which the noise of the orders does
not contain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from analysis.diagnosis.evidence.blocks import Block, blocks_of
from analysis.diagnosis.evidence.noise import Repeated, RunScatter, stamp_noise
from analysis.diagnosis.evidence.observation import GRID, ORDER_OF, STAMP_SCATTER, Sampling, curve, sampling_of
from analysis.diagnosis.fit.candidates import candidates_for, columns_for
from analysis.diagnosis.fit.responses import Linearisation, linearise, noise_um
from analysis.diagnosis.judge.budget import GapMeasure
from analysis.diagnosis.judge.residuals import places
from analysis.diagnosis.plan.expected import planned_blocks
from analysis.robot.kinematics.arm import Array
from analysis.runs.loading import Measured
from analysis.runs.tables import CircleTable
from rigs.effects import Backlash
from tests.support.diagnosis_cells import RIG, circles, planted, scatter_um, seen

LAP_S, ROWS, LAPS = 15.0, 900, 2
STEP_S = LAP_S / ROWS
T_S = STEP_S * np.arange(LAPS * ROWS)
FINE = ORDER_OF >= 60
PLAY = Backlash(axis=1, width_deg=0.5)
STILL = RunScatter(0.0, 0.0, 0.0, 0.0)


def _sampling(t_s: Array = T_S) -> Sampling:
    return sampling_of(2 * np.pi * t_s / LAP_S, (), np.empty(0)).without_trend()


def _crossing(t_s: Array, crossed_s: float = 0.03) -> Array:
    """Readings (m, 2) mm of a play of 2 mm that is crossed in the middle of each lap and, back, at its end, on a
    motion of 10 µm; the second gauge shows a third of it, with the other sign."""
    lap = t_s % LAP_S
    there, back = (np.clip((lap - at) / crossed_s, 0.0, 1.0) for at in (0.4 * LAP_S, 0.9 * LAP_S))
    play = 2.0 * (there - back) + 0.01 * np.sin(2 * np.pi * lap / LAP_S)
    return np.stack([play, -play / 3], axis=1)


def _columns(*shown_mm: Array) -> Array:
    count = len(shown_mm)
    return stamp_noise([_sampling()] * count, [T_S] * count, shown_mm)


def _energy(rows: Array) -> float:
    return float((rows**2).sum())


@pytest.mark.parametrize("crossed_s", [0.001, 0.03, 0.1])
def test_the_noise_of_stamps_is_what_late_and_early_readings_show(crossed_s: float) -> None:
    """Readings of the play at instants that scatter about their stamps, a thousand times."""
    rng, shown = np.random.default_rng(3), []
    columns = _columns(_crossing(T_S, crossed_s))
    assert 2 <= columns.shape[1] <= 20
    for _ in range(1000):
        late_s = STAMP_SCATTER * STEP_S * rng.standard_normal(len(T_S))
        shown.append(_sampling().gridded(_crossing(T_S + late_s, crossed_s)))
    scatter_mm = np.std(shown, axis=0)
    stated_mm = np.sqrt(sum(curve(one) ** 2 for one in columns.T))
    # A crossing that is quicker than a row is off by all of it or nothing, and a slope of both sides counts it twice.
    assert 0.55 < np.sqrt(_energy(stated_mm) / _energy(scatter_mm)) < 1.8
    # Both gauges move together, in opposite ways.
    gauges = np.array([curve(one)[np.argmax(np.abs(curve(one)[:, 0]))] for one in columns.T])
    np.testing.assert_allclose(gauges[:, 1], -gauges[:, 0] / 3, rtol=0.05)


def test_the_gauge_that_shows_more_decides() -> None:
    shown = _crossing(T_S)
    assert _columns(shown[:, ::-1]).shape == _columns(shown).shape


@pytest.mark.parametrize("waves", [1, 7, 40])
def test_a_wave_is_left_to_the_noise_of_the_orders(waves: int) -> None:
    wave = 0.5 * np.sin(2 * np.pi * waves * T_S / LAP_S)
    assert _columns(np.stack([wave, wave], axis=1)).shape == (len(ORDER_OF), 0)


def test_a_motion_that_is_a_few_times_quicker_than_elsewhere_is_left_too() -> None:
    """Crossings of 0.15 and of 2 mm in 0.3 s on a motion of 2 mm."""
    motion = np.sin(2 * np.pi * T_S / LAP_S)[:, None]
    assert _columns(_crossing(T_S, 0.3) * 0.075 + motion).shape[1] == 0
    assert _columns(_crossing(T_S, 0.3) + motion).shape[1] > 10


def test_what_no_gauge_resolves_is_left() -> None:
    assert _columns(1e-3 * _crossing(T_S, 0.1)).shape[1] == 0


def test_every_repeat_says_where_readings_change() -> None:
    """One run crosses the play 0.2 s after the other."""
    early, late = _crossing(T_S), _crossing(T_S - 0.2)
    both = _columns(early, late)
    assert both.shape[1] > _columns(early).shape[1]
    assert _energy(both) == pytest.approx((_energy(_columns(early)) + _energy(_columns(late))) / 2, rel=0.02)


def test_no_more_angles_than_a_sixteenth_of_a_lap() -> None:
    """Steps at fifty places: a lap of nothing but quick angles has no noise of its own."""
    steps = np.floor(T_S % LAP_S / LAP_S * 50) % 2
    assert _columns(np.stack([steps, steps], axis=1)).shape[1] == GRID // 16


def test_readings_with_the_same_stamp_have_no_slope() -> None:
    t_s = T_S.copy()
    t_s[100] = t_s[99]
    found = stamp_noise([_sampling()], [t_s], [_crossing(T_S)])
    assert np.isfinite(found).all() and found.shape[1]


def test_periods_of_standing_have_no_such_noise() -> None:
    rows = np.arange(len(T_S), len(T_S) + 5)
    standing = replace(_sampling(), stands=(rows, rows), stand_share=np.ones(2))
    shown = np.concatenate([_crossing(T_S), np.zeros((5, 2))])
    found = stamp_noise([standing], [np.concatenate([T_S, T_S[-1] + 1 + np.arange(5.0)])], [shown])
    assert found.shape[0] == len(ORDER_OF) + 4 and not found[len(ORDER_OF) :].any()


def _scattered(size: Array, seed: int = 4) -> Repeated:
    """A thousand runs with noise of `size` (N,) mm, of what a crossing shows of stamps, and with no other scatter."""
    rng, stamps = np.random.default_rng(seed), _columns(_crossing(T_S))
    noise = size * rng.standard_normal((1000, len(size)))
    none = np.zeros((len(size), 9))
    rows = noise + rng.standard_normal((1000, stamps.shape[1])) @ stamps.T
    return Repeated("yaw", rows, none, none[None], 1, stamps)


@pytest.mark.parametrize("slow_mm", [0.0003, 0.005])
def test_a_few_angles_do_not_raise_the_noise_of_all_orders(slow_mm: float) -> None:
    """White noise, and noise that is slow: at a few angles it is no scatter of stamps."""
    size = np.where(ORDER_OF < 8, slow_mm, 0.0003)
    noise, free = _scattered(size).noise(STILL, size)
    assert np.std(_scattered(size).deviations_mm[:, FINE]) > 5 * 0.0003
    for own in (FINE, ~FINE & (ORDER_OF >= 8), ORDER_OF < 8):
        expected = np.sqrt(np.mean(free[own] * size[own] ** 2))
        assert np.sqrt(np.mean(noise[:, own] ** 2)) == pytest.approx(expected, rel=0.03)
        assert 0.9 < free[own].mean() < 1


def test_deviations_without_stamps_keep_the_noise() -> None:
    size = np.full(len(ORDER_OF), 0.001)
    runs = _scattered(size)
    assert np.std(runs.without_stamps(STILL, size)) == pytest.approx(0.001, rel=0.02)
    unstamped = replace(runs, stamps=runs.stamps[:, :0])
    assert unstamped.without_stamps(STILL, size) is unstamped.deviations_mm


def test_whitened_runs_have_a_deviation_of_one() -> None:
    size = np.where(ORDER_OF < 8, 0.005, 0.001)
    assert np.cov(_scattered(size).whitened(size)[0].T) == pytest.approx(np.eye(len(size)), abs=0.2)


def _late(run: Measured, rng: np.random.Generator) -> Measured:
    """The run with readings taken a moment before or after their stamps."""
    table = run.table
    assert isinstance(table, CircleTable)
    t_s = table.t_s + STAMP_SCATTER * np.median(np.diff(table.t_s)) * rng.standard_normal(len(table.t_s))
    g_mm = np.stack([np.interp(t_s, table.t_s, gauge) for gauge in table.g_mm.T], axis=1)
    return replace(run, table=replace(table, g_mm=g_mm))


@cache
def _linear(effects: tuple[Backlash, ...], count: int, *, known: bool = True) -> Linearisation:
    """Yaw circles of an arm with a play, read by late and early stamps."""
    rng, given = np.random.default_rng(9), effects if known else ()
    runs = seen([_late(run, rng) for run in circles(effects, count=count)])
    setups = {"yaw": planted()}
    return linearise(blocks_of(runs, setups, given), setups, given)


def _fine_sd(blocks: Sequence[Block]) -> Array:
    return np.array([np.sqrt(np.mean(block.sd_mm[: len(ORDER_OF)][FINE] ** 2)) for block in blocks])


def test_a_play_that_is_known_raises_the_noise_of_repeats_a_third_as_much() -> None:
    """Single readings are up to 0.3 mm off; the noise is 0.3 µm."""
    plain, unknown, known = _linear((), 4), _linear((PLAY,), 4, known=False), _linear((PLAY,), 4)
    assert max(block.stamps_mm.shape[1] for block in (*plain.blocks, *unknown.blocks)) == 0
    assert min(block.stamps_mm.shape[1] for block in known.blocks) >= 4
    assert (_fine_sd(unknown.blocks) > 10 * _fine_sd(plain.blocks)).all()
    assert (_fine_sd(known.blocks) < 0.35 * _fine_sd(unknown.blocks)).all()


def test_a_play_does_not_raise_the_scatter_of_one_run() -> None:
    """That is the limit from which a name is material; the noise of the readings does contain it."""
    np.testing.assert_allclose(scatter_um(_linear((PLAY,), 4)), scatter_um(_linear((), 4)), rtol=0.4)
    assert (noise_um(_linear((PLAY,), 4)) > 2 * scatter_um(_linear((PLAY,), 4))).all()
    np.testing.assert_array_equal(noise_um(_linear((), 4)), scatter_um(_linear((), 4)))


def test_a_play_changes_no_assumed_noise() -> None:
    """Runs that were not repeated."""
    plain, with_play = _linear((), 1), _linear((PLAY,), 1)
    np.testing.assert_allclose(_fine_sd(with_play.blocks), _fine_sd(plain.blocks), rtol=0.01)
    np.testing.assert_allclose(scatter_um(with_play), scatter_um(plain), rtol=0.05)


def test_the_mean_of_repeats_has_less_of_it() -> None:
    one, four = (_linear((PLAY,), count).blocks[0].stamps_mm for count in (1, 4))
    assert np.sqrt(_energy(one) / _energy(four)) == pytest.approx(2.0, rel=0.2)


def test_the_residual_is_no_larger_than_noise_and_stamps() -> None:
    """Of the true model, about the true set-up."""
    for rows, block in zip(_linear((PLAY,), 4).rows, _linear((PLAY,), 4).blocks, strict=True):
        own = np.concatenate([block.scatter_mm, block.stamps_mm], axis=1)
        C = np.diag(block.sd_mm**2) + own @ own.T
        assert block.y_mm @ np.linalg.solve(C, block.y_mm) < 1.3 * (rows.stop - rows.start)
        assert _energy(block.white(block.y_mm)) > 4 * (rows.stop - rows.start)


def test_every_search_allows_for_it() -> None:
    linear = _linear((PLAY,), 4)
    columns = columns_for(linear, candidates_for(linear)[:1])
    begin = columns.set_ups.stop + linear.Z.shape[1]
    np.testing.assert_array_equal(columns.X[:, begin : begin + linear.stamps.shape[1]], linear.stamps)
    assert (columns.fixed[begin : begin + linear.stamps.shape[1]] == 1).all() and linear.stamps.shape[1] >= 8


def test_what_stamps_add_is_no_place() -> None:
    linear, rng = _linear((PLAY,), 4), np.random.default_rng(2)
    shown = [block.stamps_mm @ rng.standard_normal(block.stamps_mm.shape[1]) for block in linear.blocks]
    assert places(linear.blocks, shown, GapMeasure(linear).scatter_mm()) == ()
    assert places(linear.blocks, shown, [block.stamps_mm[:, :0] for block in linear.blocks])


def test_planned_repeats_have_less_of_it() -> None:
    rig = RIG.model_copy(update={"effects": (PLAY,)})
    (one, *_), (four, *_) = (planned_blocks(rig, ["yaw"], runs)[0] for runs in (1, 4))
    np.testing.assert_allclose(one.stamps_mm, 2 * four.stamps_mm)
    assert one.stamps_mm.any()
