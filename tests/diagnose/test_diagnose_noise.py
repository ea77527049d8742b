"""Noise from repeats: its spectrum by bands, and how runs sit elsewhere; assumed where nothing is repeated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cells import Array, circles, seen, table_of

from analysis.diagnose.blocks import blocks_of
from analysis.diagnose.noise import RunNoise, noise_of, reading_sd, shaken_by
from analysis.diagnose.observed import ORDER_OF
from analysis.diagnose.settle import settled
from analysis.fitting.observation import observe
from analysis.model.predict import model_of, nominal_setup

BANDS = (0, 4, 18, 90, len(ORDER_OF))
HALF = len(ORDER_OF) // 2
RNG = np.random.default_rng(11)
SHAKEN = RNG.normal(0.0, 0.005, (len(ORDER_OF), 9))
PLANTED_MM = np.where(ORDER_OF < 18, 0.004, 0.001) * np.where(np.arange(len(ORDER_OF)) < HALF, 1.0, 0.5)


def _repeats(count: int, joints: float, ball: float, seed: int) -> Array:
    rng = np.random.default_rng(seed)
    elsewhere = rng.normal(size=(count, 9)) * ([joints] * 6 + [ball] * 3)
    systematic = rng.normal(0.0, 0.1, len(ORDER_OF))
    return systematic + elsewhere @ SHAKEN.T + rng.normal(0.0, PLANTED_MM, (count, len(ORDER_OF)))


def _noise(joints: float, ball: float, seed: int = 0) -> RunNoise:
    groups = [(_repeats(4, joints, ball, 10 * seed + k), SHAKEN) for k in range(4)]
    return noise_of(groups, ORDER_OF, BANDS, 1.0)


def test_a_planted_spectrum_is_found_whatever_the_scatter() -> None:
    for scatter in (0.0, 3.0):
        found = _noise(scatter, scatter)
        assert found.measured
        np.testing.assert_allclose(found.sd_mm, PLANTED_MM, rtol=0.25)


@pytest.mark.parametrize(("joints", "ball"), [(0.0, 0.0), (2.0, 0.5), (0.25, 5.0)])
def test_planted_scatter_is_found_within_a_factor(joints: float, ball: float) -> None:
    found = [_noise(joints, ball, seed) for seed in range(3)]
    for planted_size, sizes in ((joints, [f.joints for f in found]), (ball, [f.ball for f in found])):
        assert planted_size / 2 <= np.median(sizes) <= max(2 * planted_size, 0.1)
    assert found[0].scatter(6).tolist() == [found[0].joints] * 6
    assert found[0].scatter(9).tolist() == [found[0].joints] * 6 + [found[0].ball] * 3


def test_noise_is_assumed_where_nothing_is_repeated() -> None:
    found = noise_of([(_repeats(1, 0, 0, 1), SHAKEN), (_repeats(1, 0, 0, 2), SHAKEN)], ORDER_OF, BANDS, 1.0)
    assert not found.measured and (found.joints, found.ball) == (1.0, 1.0)
    assert (found.sd_mm > 5e-4).all() and (found.sd_mm < 0.02).all()
    few = noise_of([(_repeats(1, 0, 0, 1), SHAKEN), (_repeats(2, 0, 0, 2), SHAKEN)], ORDER_OF, BANDS, 1.0)
    assert few.measured


def test_readings_at_targets_are_as_noisy_as_their_repeats() -> None:
    noise = RunNoise(np.full(len(ORDER_OF), 0.003), 1.0, 1.0, measured=True, order=ORDER_OF, averaged=1.0)
    rows = 0.4 + np.random.default_rng(5).normal(0.0, 0.02, (5, 400))
    sd = reading_sd(rows, np.zeros((400, 9)), noise, np.zeros(6), poses=False)
    np.testing.assert_allclose(sd, 0.02, rtol=0.1)


def test_a_single_reading_has_the_noise_of_the_circles_and_of_rounding() -> None:
    noise = RunNoise(np.full(len(ORDER_OF), 0.003), 1.0, 1.0, measured=True, order=ORDER_OF, averaged=1.0)
    shaken = np.zeros((7, 9))
    shaken[:, 2] = 0.002
    plain = reading_sd(np.zeros((1, 7)), shaken, noise, np.zeros(6), poses=False)
    np.testing.assert_allclose(plain, 0.003)
    # One scatter of 0.0002° is one `shaken`; a rounding twice that moves twice as far.
    coarse = reading_sd(np.zeros((1, 7)), shaken, noise, np.array([0, 0, 4e-4, 0, 0, 0]), poses=False)
    np.testing.assert_allclose(coarse, np.hypot(0.003, 0.004))
    # A grid that leaves half the power of white noise stands for readings of twice that.
    halved = reading_sd(np.zeros((1, 7)), np.zeros((7, 9)), replace(noise, averaged=0.5), np.zeros(6), poses=False)
    np.testing.assert_allclose(halved, 0.003 * np.sqrt(2))
    guessed = replace(noise, measured=False)
    assert (reading_sd(np.zeros((1, 7)), shaken, guessed, np.zeros(6), poses=True) > 0.01).all()


def test_scatter_shows_as_far_as_it_moves_the_tool() -> None:
    """0.0002° of axis 1 and 1 µm of the ball, as on the page."""
    table = table_of("radial", None, None)
    model = model_of(circles()[0].rig)
    one = observe(model, table, "run")
    shaken = shaken_by(model, one, nominal_setup(model.rig, table))[:, 0]
    assert shaken.shape == (len(one.rows), 9)
    np.testing.assert_allclose(np.linalg.norm(shaken[:, 6:], axis=1), 0.001, rtol=1e-3)
    assert 0.5 < np.abs(shaken[:, 0]).max() / (np.radians(2e-4) * np.hypot(930.8, 87.8)) < 1.01


def test_simulated_repeats_tell_their_own_scatter_and_give_white_residuals() -> None:
    runs = seen(circles(seed=3, count=4))
    setups, _ = settled(runs)
    blocks, noise = blocks_of(runs, setups)
    assert [block.count for block in blocks] == [4, 4]
    assert noise.measured and 0.3 <= noise.joints <= 3
    assert np.mean(np.concatenate([block.y for block in blocks]) ** 2) == pytest.approx(1.0, abs=0.12)
