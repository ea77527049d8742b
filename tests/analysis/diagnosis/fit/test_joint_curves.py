from functools import partial

import numpy as np
import pytest
from numpy.typing import NDArray

from analysis.diagnosis.fit.joint_curves import CurveColumns, JointCurves, curve_columns
from rigs.effects import Effect, TransmissionError

Array = NDArray[np.float64]
ORDERS = np.arange(1, 61)
WAVES: tuple[Effect, ...] = tuple(
    TransmissionError(axis=2, order=float(order), amplitude_deg=0.005, phase_deg=phase)
    for order in ORDERS
    for phase in (0.0, 90.0)
)


def test_joint_with_little_motion_has_no_large_waves_that_imitate_a_zero():
    effects = [WAVES[k] for k in (0, 8, 118)]  # of once, 5 and 60 times a turn, of which 19° are 0.05, 0.26 and 3
    widths = JointCurves((9.0, 20.0), 1.0)
    free, held = (curve_columns(effects, turned) for turned in ((), (1.0, 19 / 360)))
    assert held.variance(widths)[0] == 1.0 < free.variance(widths)[0]
    assert held.variance(widths)[1:] == pytest.approx(free.variance(widths)[1:])


def _likelihood(
    X: Array, y: Array, columns: CurveColumns, curves: JointCurves, strength: Array
) -> tuple[float, Array, Array]:
    """The log likelihood of readings (N,) in noise of a strength (1,), by the dense covariance, and its derivatives."""
    variance = columns.variance(curves)
    C = strength * np.eye(len(y)) + (X * variance) @ X.T
    inverse = np.linalg.inv(C)
    weighed = inverse @ y
    slope = 0.5 * variance * ((X.T @ weighed) ** 2 - (X * (inverse @ X)).sum(axis=0))
    of_noise = 0.5 * strength * (weighed @ weighed - np.trace(inverse))
    return -0.5 * float(y @ weighed + np.linalg.slogdet(C)[1]), slope, of_noise


def _drawn(seed: int, width: float, decay: float) -> tuple[Array, Array]:
    """Waves (N, c) of a joint over a third of a turn, and readings (N,) of a curve with a noise of two units."""
    rng = np.random.default_rng(seed)
    angle = rng.uniform(0, 2.1, 300)
    X = np.repeat(ORDERS, 2) * angle[:, None]
    X = np.where(np.arange(X.shape[1]) % 2 == 0, np.sin(X), np.cos(X))
    size = width * np.repeat(ORDERS, 2) ** -decay * rng.normal(size=X.shape[1])
    return X, X @ size + 2 * rng.normal(size=300)


@pytest.mark.parametrize(("width", "decay"), [(10.0, 1.0), (4.0, 0.6), (15.0, 1.4)])
def test_width_decay_and_noise_are_those_of_the_readings(width, decay):
    columns, found, noise = curve_columns(WAVES), [], []
    for seed in range(4):
        X, y = _drawn(seed, width, decay)
        curves, strength = columns.fitted(
            JointCurves((1.0,) * 6), np.array([50.0]), np.array([[0.1], [1e6]]), partial(_likelihood, X, y, columns)
        )
        found.append(curves)
        noise.append(float(strength[0]))
    # What a third of a turn shows of a curve is its size at the orders in the middle.
    middle = [one.widths[1] * 10**-one.decay for one in found]
    assert np.exp(np.mean(np.log(middle))) == pytest.approx(width * 10**-decay, rel=0.35)
    assert np.mean([one.decay for one in found]) == pytest.approx(decay, abs=0.2)
    assert np.mean(noise) == pytest.approx(4.0, rel=0.25)  # begun far above, where all of the curve looks like noise
    assert all(0.4 < one.widths[0] < 1.1 for one in found)  # no readings: about what was expected
