from dataclasses import astuple, replace

import numpy as np
import pytest

from analysis.diagnosis.evidence.blocks import blocks_of
from analysis.diagnosis.evidence.noise import (
    CircleNoise,
    Repeated,
    RunScatter,
    circle_noise,
    scatter_columns,
    target_sd,
)
from analysis.diagnosis.evidence.observation import ORDER_OF
from analysis.diagnosis.evidence.setups import fit_run_setups
from analysis.diagnosis.fit.responses import linearise
from analysis.runs.noise.cell_noise import SLOW_MM, WHITE_MM
from tests.support.diagnosis_cells import Array, circles, no_background, seen

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


@pytest.mark.parametrize("scatter", [STILL, RunScatter(2.0, 2.0, 2.0, 2.0)])
def test_planted_spectrum_is_found_at_any_scatter(scatter):
    found = _noise(scatter=scatter)
    assert found.measured
    for sd in found.sd_mm:
        np.testing.assert_allclose(np.median(sd / SHAPE_MM), 1.0, rtol=0.15)
    np.testing.assert_allclose(np.mean(np.concatenate(found.sd_mm), axis=0), SHAPE_MM, rtol=0.35)


def test_each_run_has_its_own_level():
    for sd in _noise(levels=LEVELS).sd_mm:
        np.testing.assert_allclose(np.median(sd / SHAPE_MM, axis=1), LEVELS, rtol=0.3)


@pytest.mark.parametrize(("joints", "ball"), [(0.0, 0.0), (2.0, 0.5), (0.25, 5.0)])
@pytest.mark.parametrize("drifting", [0.0, 1.0])
def test_planted_scatter_is_found_within_a_factor(joints, ball, drifting):
    planted = RunScatter(joints, ball, drifting * joints, drifting * ball)
    noise = _noise(scatter=planted)
    for size, seen_size in zip(astuple(planted), astuple(noise.scattered["yaw"]), strict=True):
        assert size / 2 <= seen_size <= max(2 * size, 0.5 * max(joints, ball), 0.3)
    found = noise.scatter("yaw")
    assert found.constant(9).tolist() == [found.joints] * 6 + [found.ball] * 3
    np.testing.assert_allclose(astuple(noise.scatter("radial")), astuple(found))


def test_a_run_that_was_not_repeated_borrows_the_noise_of_its_set_up():
    own = [_repeats(0), _repeats(1, (1.0,)), _repeats(2, setup="roll", size=10.0)]
    found = circle_noise(own, 1.0)
    assert found.measured and len(found.sd_mm[1]) == 1
    np.testing.assert_allclose(np.median(found.sd_mm[1] / SHAPE_MM), 1.0, rtol=0.2)


def test_noise_is_assumed_without_repeats():
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


def test_readings_at_targets_are_as_noisy_as_their_repeats():
    sd, is_measured = _targets(0.4 + np.random.default_rng(5).normal(0.0, 0.02, (5, 400)))
    assert is_measured and np.median(sd[1:]) == pytest.approx(0.02, rel=0.1)


def test_simulated_repeats_show_their_own_scatter_and_give_white_residuals():
    runs = seen(circles(seed=3, count=4))
    setups, _ = fit_run_setups(runs)
    blocks = blocks_of(runs, setups)
    assert [block.count for block in blocks] == [4, 4] and all(block.measured for block in blocks)
    linear = linearise(blocks, setups)
    marginal = no_background(linear, linear.Z).marginal(linear.y[:, None])
    energy = marginal.products(marginal)[0, 0]
    assert energy / len(linear.y) == pytest.approx(1.0, abs=0.2)
