"""Noise from repeats: spectrum, level of each run, and scatter between runs; assumed if there are no repeats."""

from __future__ import annotations

from dataclasses import astuple, replace

import numpy as np
import pytest

from analysis.diagnosis.evidence.blocks import blocks_of
from analysis.diagnosis.evidence.noise import (
    SCATTER_MM,
    CircleNoise,
    Repeated,
    RunScatter,
    circle_noise,
    drift_waves,
    scatter_columns,
    scatter_response,
    target_sd,
)
from analysis.diagnosis.evidence.observation import ORDER_OF, observe
from analysis.diagnosis.evidence.setups import fit_run_setups
from analysis.diagnosis.fit.responses import linearise
from analysis.procedures.shared.test_kind import nominal_setup
from analysis.robot.model.predict import model_of
from analysis.runs.noise.cell_noise import SLOW_MM, TARGET_MM, WHITE_MM
from analysis.runs.tables import CircleTable
from tests.support.diagnosis_cells import Array, circles, measured, no_background, planted, seen, table_of

HALF = len(ORDER_OF) // 2
SHAKEN = np.random.default_rng(11).normal(0.0, 0.005, (len(ORDER_OF), 9))
DRIFTING = np.random.default_rng(12).normal(0.0, 0.005 / np.sqrt(3), (2, len(ORDER_OF), 9))
"""Two waves of a drift: those of a run of two laps that repeat in each."""
NO_STAMPS = np.empty((len(ORDER_OF), 0))
SHAPE_MM = np.where(ORDER_OF < 18, 0.004, 0.001) * np.where(np.arange(len(ORDER_OF)) < HALF, 1.0, 0.5)
LEVELS = (1.0, 2.0, 4.0, 1.5)
"""Of four runs: a gauge's level in a real cell differs from run to run by a factor of four."""


STILL = RunScatter(0.0, 0.0, 0.0, 0.0)


def _repeats(
    seed: int,
    levels: tuple[float, ...] = (1.0,) * 4,
    scatter: RunScatter = STILL,
    setup: str = "yaw",
    size: float = 1.0,
) -> Repeated:
    rng, count = np.random.default_rng(seed), len(levels)
    moved = scatter_columns(SHAKEN, DRIFTING, scatter)
    elsewhere = rng.normal(size=(count, moved.shape[1])) @ moved.T
    noise = size * np.array(levels)[:, None] * rng.normal(0.0, SHAPE_MM, (count, len(ORDER_OF)))
    return Repeated(setup, rng.normal(0.0, 0.1, len(ORDER_OF)) + elsewhere + noise, SHAKEN, DRIFTING, 2, NO_STAMPS)


def _noise(*, levels: tuple[float, ...] = (1.0,) * 4, scatter: RunScatter = STILL) -> CircleNoise:
    return circle_noise([_repeats(k, levels, scatter) for k in range(4)], 1.0)


@pytest.mark.parametrize("scatter", [STILL, RunScatter(3.0, 3.0, 0.0, 0.0), RunScatter(2.0, 2.0, 2.0, 2.0)])
def test_a_planted_spectrum_is_found_whatever_the_scatter(scatter: RunScatter) -> None:
    found = _noise(scatter=scatter)
    assert found.measured
    for sd in found.sd_mm:
        np.testing.assert_allclose(np.median(sd / SHAPE_MM), 1.0, rtol=0.15)
    np.testing.assert_allclose(np.mean(np.concatenate(found.sd_mm), axis=0), SHAPE_MM, rtol=0.35)


def test_each_run_has_its_own_level() -> None:
    for sd in _noise(levels=LEVELS).sd_mm:
        np.testing.assert_allclose(np.median(sd / SHAPE_MM, axis=1), LEVELS, rtol=0.3)


def test_two_runs_share_a_level() -> None:
    """The difference of two runs does not show which of them is noisier."""
    (sd,) = circle_noise([_repeats(5, (1.0, 3.0))], 1.0).sd_mm
    np.testing.assert_allclose(sd[0], sd[1])
    np.testing.assert_allclose(np.median(sd[0] / SHAPE_MM), np.sqrt(5), rtol=0.2)


@pytest.mark.parametrize(("joints", "ball"), [(0.0, 0.0), (2.0, 0.5), (0.25, 5.0)])
@pytest.mark.parametrize("drifting", [0.0, 1.0])
def test_planted_scatter_is_found_within_a_factor(joints: float, ball: float, drifting: float) -> None:
    planted = RunScatter(joints, ball, drifting * joints, drifting * ball)
    noise = _noise(scatter=planted)
    for size, seen_size in zip(astuple(planted), astuple(noise.scattered["yaw"]), strict=True):
        assert size / 2 <= seen_size <= max(2 * size, 0.5 * max(joints, ball), 0.3)
    found = noise.scatter("yaw")
    assert found.constant(9).tolist() == [found.joints] * 6 + [found.ball] * 3
    np.testing.assert_allclose(astuple(noise.scatter("radial")), astuple(found))


@pytest.mark.parametrize("size", [0.0, 10.0])
def test_noise_that_scatter_hides_is_no_less_than_that_of_finer_orders(size: float) -> None:
    """Joints that scatter and drift along a run explain every slow order of a few repeats; some of it is noise."""
    rng, slow = np.random.default_rng(9), ORDER_OF < 4
    response = np.where(slow[:, None], rng.normal(0.0, 0.005, (len(ORDER_OF), 9)), 0.0)
    drifting = np.where(slow[:, None], rng.normal(0.0, 0.003, (6, len(ORDER_OF), 9)), 0.0)
    moved = scatter_columns(response, drifting, RunScatter(size, size, size, size))
    noise = rng.normal(0.0, SHAPE_MM, (3, len(ORDER_OF)))
    rows = rng.normal(size=(3, moved.shape[1])) @ moved.T + noise
    (sd,) = circle_noise([Repeated("yaw", rows, response, drifting, 2, NO_STAMPS)], 1.0).sd_mm
    ratio = sd[:, slow] / SHAPE_MM[slow]
    assert ratio.min() > 0.4 and ratio.max() < 4.0


def test_each_set_up_has_its_own_noise() -> None:
    """Ball, gauges and cables are mounted anew between set-ups: one may be ten times as noisy, at some orders only."""
    quiet = [_repeats(k) for k in range(2)]
    noisy = [_repeats(k + 2, setup="roll", size=10.0) for k in range(2)]
    found = circle_noise([*quiet, *noisy], 1.0)
    for sd, size in zip(found.sd_mm, (1.0, 1.0, 10.0, 10.0), strict=True):
        np.testing.assert_allclose(np.median(sd / SHAPE_MM), size, rtol=0.2)


def test_a_run_that_was_not_repeated_borrows_the_noise_of_its_set_up() -> None:
    own = [_repeats(0), _repeats(1, (1.0,)), _repeats(2, setup="roll", size=10.0)]
    found = circle_noise(own, 1.0)
    assert found.measured and len(found.sd_mm[1]) == 1
    np.testing.assert_allclose(np.median(found.sd_mm[1] / SHAPE_MM), 1.0, rtol=0.2)


def test_another_run_differs_from_the_mean_by_the_noise_and_a_drifting_scatter() -> None:
    """The energy of its slow orders, in standard deviations, is one each: what the noise of a diagnosis must hold."""
    scatter, ratios = RunScatter(3.0, 3.0, 3.0, 3.0), []
    slow = ORDER_OF < 8
    for seed in range(6):
        runs = _repeats(seed, (1.0,) * 5, scatter)
        few = replace(runs, rows=runs.rows[:4])
        found = circle_noise([few], 1.0)
        columns = scatter_columns(SHAKEN, DRIFTING, found.scatter("yaw"))[slow]
        C = 1.25 * (np.diag((found.sd_mm[0][:, slow] ** 2).mean(axis=0)) + columns @ columns.T)
        off = (runs.rows[4] - few.rows.mean(axis=0))[slow]
        ratios.append(off @ np.linalg.solve(C, off) / len(off))
    assert 0.5 < np.mean(ratios) < 1.6


def test_noise_is_assumed_where_nothing_is_repeated() -> None:
    still = [replace(_repeats(seed, (1.0,)), response=1e-9 * SHAKEN, drifting=0 * DRIFTING, laps=1) for seed in (1, 2)]
    found = circle_noise(still, 1.0)
    assert not found.measured and [len(sd) for sd in found.sd_mm] == [1, 1]
    # A channel of HALF entries holds HALF times the mean square of its readings.
    power = (found.sd_mm[0][0, :HALF] ** 2).mean()
    assert power == pytest.approx(WHITE_MM.rms**2 + SLOW_MM.rms**2, rel=0.01)
    few = circle_noise([_repeats(1, (1.0,)), _repeats(2, (1.0, 1.0))], 1.0)
    assert few.measured


def _targets(rows: Array) -> tuple[Array, bool]:
    return target_sd(rows, np.eye(rows.shape[1])[:, :1], np.arange(rows.shape[1]))


def test_readings_at_targets_are_as_noisy_as_their_repeats() -> None:
    sd, is_measured = _targets(0.4 + np.random.default_rng(5).normal(0.0, 0.02, (5, 400)))
    assert is_measured and np.median(sd[1:]) == pytest.approx(0.02, rel=0.1)


def test_each_target_has_its_own_scatter() -> None:
    planted = np.where(np.arange(400) % 2, 0.06, 0.006)
    sd, _ = _targets(np.random.default_rng(6).normal(0.0, planted, (8, 400)))
    assert np.median(sd[1::2]) > 2.5 * np.median(sd[2::2])


def test_a_wild_reading_is_that_of_its_target_alone() -> None:
    rows = np.random.default_rng(7).normal(0.0, 0.02, (5, 400))
    plain, _ = _targets(rows)
    rows[0, 1:400:40] += 2.0
    wild, _ = _targets(rows)
    others = np.arange(400) % 40 != 1
    np.testing.assert_allclose(wild[others], plain[others], rtol=0.05)
    assert (wild[1::40] > 10 * np.median(wild)).all()


def test_targets_that_were_reached_once_have_the_scatter_of_real_cells() -> None:
    sd, is_measured = _targets(np.zeros((1, 30)))
    assert not is_measured
    np.testing.assert_allclose(sd, TARGET_MM.rms)


def test_scatter_shows_as_far_as_it_moves_the_tool() -> None:
    """0.0002° of axis 1 and 1 µm of the ball, as on the page."""
    table = table_of("radial", None, None)
    model = model_of(circles()[0].rig)
    one = observe(model, table, "run")
    response = scatter_response(one, nominal_setup(model.rig, table))[:, 0]
    assert response.shape == (len(one.rows), 9)
    np.testing.assert_allclose(np.linalg.norm(response[:, 6:], axis=1), 0.001, rtol=1e-3)
    assert 0.5 < np.abs(response[:, 0]).max() / (np.radians(2e-4) * np.hypot(930.8, 87.8)) < 1.01


def test_simulated_repeats_show_their_own_scatter_and_give_white_residuals() -> None:
    runs = seen(circles(seed=3, count=4))
    setups, _ = fit_run_setups(runs)
    blocks = blocks_of(runs, setups)
    assert [block.count for block in blocks] == [4, 4] and all(block.measured for block in blocks)
    linear = linearise(blocks, setups)
    marginal = no_background(linear, linear.Z).marginal(linear.y[:, None])
    energy = marginal.products(marginal)[0, 0]
    assert energy / len(linear.y) == pytest.approx(1.0, abs=0.2)


def test_a_drift_is_as_strong_at_any_time_of_a_run() -> None:
    """Waves of unknown phase: a unit scatter in all of them is a unit scatter at each time."""
    np.testing.assert_allclose((drift_waves(np.linspace(0.0, 1.0, 50)) ** 2).sum(axis=0), 1.0)


def test_a_ball_that_drifts_along_its_runs_does_not_count_as_noise() -> None:
    """10 µm in three waves of the time of a run, as from warming: the noise of slow orders stays that of still runs."""
    still = circles(seed=3, count=4)
    rng, moved = np.random.default_rng(8), []
    for run in still:
        table = run.table
        assert isinstance(table, CircleTable)
        one = observe(model_of(run.rig), table, "run")
        response = scatter_response(one, planted())[:, :, 6:] / SCATTER_MM
        rows = one.path.rows[one.rows]
        waves = drift_waves((table.t_s[rows] - table.t_s[0]) / np.ptp(table.t_s))
        drift_mm = 0.010 * np.einsum("wm,wc->mc", waves, rng.normal(size=(len(waves), 3)))
        g_mm = table.g_mm.copy()
        g_mm[rows] += np.einsum("mkc,mc->mk", response, drift_mm)
        moved.append(replace(run, table=replace(table, g_mm=g_mm)))
    slow = ORDER_OF < 8
    power = []
    for runs in (seen(still), seen(moved)):
        blocks = blocks_of(runs, fit_run_setups(runs)[0])
        power.append(np.mean([(block.sd_mm[: len(slow)][slow] ** 2).mean() for block in blocks]))
    assert power[1] < 6 * power[0]


def test_a_single_run_is_said_to_have_assumed_noise() -> None:
    runs = seen([*circles(seed=3, count=1), measured(table_of("radial", None, 1), "radial", "radial")])
    blocks = blocks_of(runs, fit_run_setups(runs)[0])
    assert not any(block.measured for block in blocks if block.sampling)
