import numpy as np
import pytest

from analysis.procedures.direction_pair import largest
from analysis.procedures.shared.lap_curve import PHI, at_resolution
from analysis.runs.noise.readings import noise_beneath, rounding_error
from analysis.runs.noise.spectrum import DRAWS, NODES

DEG = np.degrees(PHI)
PLATEAU = at_resolution(np.where((DEG > 60) & (DEG < 200), 1.0, -0.6))
PEAK = at_resolution(np.exp(-0.5 * ((DEG - 140) / 6) ** 2))
CASES = 60


def _noise(rng: np.random.Generator, *shape: int) -> np.ndarray:
    return at_resolution(0.05 * rng.standard_normal((*shape, NODES)))


@pytest.mark.parametrize(("truth", "sign"), [(PLATEAU, 1.0), (PLATEAU, -1.0), (PEAK, 1.0)])
def test_the_size_is_unbiased_and_within_2u(truth, sign):
    rng, true = np.random.default_rng(1), np.abs(truth).max()
    errors = _noise(rng, DRAWS)
    curves = [sign * truth + _noise(rng) for _ in range(CASES)]
    found = [largest(curve, errors, 0.0, "mm", 1)[0] for curve in curves]
    off, u = np.array([figure.value for figure in found]) - true, np.array([figure.u for figure in found])
    assert abs(off.mean()) < 0.5 * u.mean()
    assert np.mean(np.abs(off) <= 2 * u) >= 0.9 and u.mean() < 2.5 * np.sqrt((off**2).mean())
    if truth is PLATEAU:
        assert np.mean([np.abs(curve).max() for curve in curves]) - true > u.mean()  # the maximum itself is too large


def test_place_of_a_plateau_or_peak_is_within_2u():
    rng = np.random.default_rng(2)
    errors, inside = _noise(rng, DRAWS), np.flatnonzero(PLATEAU > 1 - 1e-6)
    covered = []
    for _ in range(CASES):
        _, place = largest(PLATEAU + _noise(rng), errors, 0.0, "mm", 1)
        covered.append(abs(place.value - DEG[rng.choice(inside)]) <= 2 * place.u)
        assert place.u < 70
    assert np.mean(covered) >= 0.9
    _, place = largest(PEAK + _noise(rng), errors, 0.0, "mm", 1)
    assert abs(place.value - 140) <= 2 * place.u < 12


def test_uncertain_places_do_not_lower_a_narrow_peak():
    still = np.zeros((DRAWS, NODES))
    known, blurred = (largest(PEAK, still, blur, "mm", 1)[0] for blur in (0.0, np.radians(3)))
    assert known.value == pytest.approx(PEAK.max()) and known.u == 0
    assert blurred.value - known.value == pytest.approx(blurred.u) and blurred.u > 0.05
    assert largest(PLATEAU, still, np.radians(3), "mm", 1)[0].u < 1e-3  # a plateau loses nothing


@pytest.mark.parametrize("noise", [0.0, 0.2, 0.6, 1.0, 2.0])
def test_noise_below_gauge_steps_is_found_from_half_a_step(noise):
    """Below a third of a step nobody sees it, and it is taken for none."""
    rng = np.random.default_rng(3)
    readings = np.round(40 * np.sin(np.linspace(0, 4 * np.pi, 6000)) + noise * rng.standard_normal(6000))
    assert noise_beneath(readings, 1.0) == pytest.approx(noise if noise > 0.35 else 0.0, abs=0.1)


def test_the_error_of_rounding_is_as_large_as_rounding_makes_it():
    """Averaged at a point with a hundred readings, and full for a single reading on a steep part of the curve."""
    rng, step = np.random.default_rng(4), 1.0
    fine = np.linspace(0, 2 * np.pi, 100 * NODES, endpoint=False)
    for amplitude in (2.0, 400.0):
        curve = amplitude * np.sin(fine)
        phase = rng.uniform(0, step, 50)[:, None]
        mean, own = rounding_error(amplitude * np.sin(PHI + fine[50]), step, 0.0, phase[:, 0])
        off = (np.round(curve + phase) - curve - phase).reshape(50, NODES, 100)
        assert mean.std() == pytest.approx(off.mean(axis=2).std(), rel=0.1)
        assert own.mean() == pytest.approx(off.var(axis=2).mean(), abs=step**2 / 60)
