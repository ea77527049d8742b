import numpy as np
import pytest

from analysis.apps.commission.slow_noise import regress

T_S = np.linspace(0, 10, 60)
DESIGN = np.stack([np.ones(60), np.cos(T_S), np.sin(T_S)], axis=1)
TRUTH = np.array([0.3, -1.0, 2.0])


def wander(rng: np.random.Generator, tau: float) -> np.ndarray:
    """A moving average of white noise, (60,), which no kernel of the regression is."""
    width = max(1, int(tau / (T_S[1] - T_S[0])))
    noise = np.convolve(rng.normal(size=60 + width), np.ones(width) / np.sqrt(width), mode="valid")
    return noise[:60]


@pytest.mark.parametrize("tau", [0.0, 1.0])
def test_errors_are_as_large_as_stated(tau):
    off = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        readings = DESIGN @ TRUTH + 0.01 * wander(rng, tau)
        ((value, covariance),) = regress(DESIGN, readings[:, None], T_S, np.ones(60))
        off.append((value - TRUTH) / np.sqrt(np.diag(covariance)))
    within = np.mean(np.abs(off) < 1.96)
    assert within > 0.85 and np.sqrt(np.mean(np.square(off))) > 0.5


def test_exact_readings_give_the_coefficients():
    ((value, covariance),) = regress(DESIGN, (DESIGN @ TRUTH)[:, None], T_S, np.ones(60))
    np.testing.assert_allclose(value, TRUTH, atol=1e-9)
    assert np.isfinite(covariance).all()
