import numpy as np
import pytest

from analysis.runs.noise.readings import shared_rounding, step_of_stops


@pytest.mark.parametrize("step_mm", [0.01, 0.001, 0.0005 * 25.4])
@pytest.mark.parametrize("count", [10, 24, 400])
def test_a_step_is_found_in_few_readings_and_in_many(step_mm, count):
    rng = np.random.default_rng(count)
    readings = np.round(rng.normal(0, 0.08, count) / step_mm) * step_mm
    assert step_of_stops(readings) == pytest.approx(step_mm, rel=0.01)


@pytest.mark.parametrize("count", [10, 24, 400])
def test_continuous_readings_have_no_step(count):
    found = [step_of_stops(np.random.default_rng(seed).normal(0, 0.3, count)) for seed in range(300)]
    assert np.count_nonzero(found) <= 1


def test_coarse_step_is_a_multiple_of_a_usual_one():
    assert step_of_stops(np.array([0.0, 0.08, -0.08, 0.0, 0.0, 0.08, 0.0, 0.0, -0.08, 0.0])) == 0.010
    assert step_of_stops(np.array([0.25] * 10)) == 0.0


@pytest.mark.parametrize("noise_steps", [0.0, 0.1, 0.2, 0.5])
def test_common_error_of_a_place_agrees_with_a_trial(noise_steps):
    rng = np.random.default_rng(0)
    place = rng.uniform(-0.5, 0.5, 2000)
    readings = np.round(place[:, None] + noise_steps * rng.normal(size=(2000, 500)))
    shared = float(((readings.mean(axis=1) - place) ** 2).mean()) - float(readings.var(axis=1, ddof=1).mean()) / 500
    assert shared_rounding(1.0, np.array([[noise_steps**2]]))[0, 0] == pytest.approx(shared, rel=0.1, abs=2e-3)
