"""Stamps that scatter make a few angles of a lap noisy where a joint crosses a play, which the noise of
the orders does not contain."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.diagnosis.observed_run import GRID, ORDER_OF, STAMP_SCATTER, Sampling, curve, sampling_of
from analysis.diagnosis.stamp_noise import stamp_noise, without_stamp_noise
from analysis.kinematics.arm import Array

LAP_S, ROWS, LAPS = 15.0, 900, 2
STEP_S = LAP_S / ROWS
T_S = STEP_S * np.arange(LAPS * ROWS)


def _sampling() -> Sampling:
    return sampling_of(2 * np.pi * T_S / LAP_S, (), np.empty(0))


def _crossing(t_s: Array, crossed_s: float = 0.03) -> Array:
    """Readings (m, 2) mm of a play of 2 mm that is crossed in the middle of each lap and, back, at its end; the second
    gauge shows a third of it, with the other sign."""
    lap = t_s % LAP_S
    there, back = (np.clip((lap - at) / crossed_s, 0.0, 1.0) for at in (0.4 * LAP_S, 0.9 * LAP_S))
    play = 2.0 * (there - back)
    return np.stack([play, -play / 3], axis=1)


def test_the_noise_of_stamps_is_what_late_and_early_readings_show() -> None:
    """Readings of the play at instants that scatter about their stamps, a thousand times."""
    sampling, rng = _sampling(), np.random.default_rng(3)
    columns = stamp_noise(sampling, T_S, _crossing(T_S))
    assert 2 <= columns.shape[1] <= 8
    shown = []
    for _ in range(1000):
        late_s = STAMP_SCATTER * STEP_S * rng.standard_normal(len(T_S))
        shown.append(sampling.gridded(_crossing(T_S + late_s)))
    scatter_mm = np.std(shown, axis=0)
    stated_mm = np.sqrt(sum(curve(one) ** 2 for one in columns.T))
    # The crossing is nearly as quick as the stamps scatter, so the slope of the model is that of a few rows.
    assert np.sum(stated_mm**2) == pytest.approx(np.sum(scatter_mm**2), rel=0.6)
    seen = scatter_mm[:, 0] > 0.2 * scatter_mm[:, 0].max()
    assert (stated_mm[seen, 0] > 0.1 * scatter_mm[seen, 0]).all()
    # Both gauges move together, in opposite ways.
    gauges = np.array([curve(one)[np.argmax(np.abs(curve(one)[:, 0]))] for one in columns.T])
    np.testing.assert_allclose(gauges[:, 1], -gauges[:, 0] / 3, rtol=0.05)


@pytest.mark.parametrize("waves", [1, 7, 40])
def test_a_wave_is_left_to_the_noise_of_the_orders(waves: int) -> None:
    wave = 0.5 * np.sin(2 * np.pi * waves * T_S / LAP_S)
    assert stamp_noise(_sampling(), T_S, np.stack([wave, wave], axis=1)).shape == (len(ORDER_OF), 0)


def test_a_few_angles_do_not_raise_the_noise_of_all_orders() -> None:
    sampling, rng = _sampling(), np.random.default_rng(4)
    stamps = stamp_noise(sampling, T_S, _crossing(T_S))
    white = 0.001 * rng.standard_normal((200, len(ORDER_OF)))
    rows = white + rng.standard_normal((200, stamps.shape[1])) @ stamps.T
    assert np.std(rows) > 5 * np.std(white)
    assert np.std(without_stamp_noise(rows, stamps)) == pytest.approx(0.001, rel=0.02)


def test_without_quick_angles_nothing_changes() -> None:
    rows = np.ones((3, len(ORDER_OF)))
    assert without_stamp_noise(rows, np.empty((len(ORDER_OF), 0))) is rows


def test_no_more_angles_than_a_sixteenth_of_a_lap() -> None:
    """A hundred short steps: a lap of nothing but quick angles has no noise of its own."""
    t_s = T_S % LAP_S
    steps = np.floor(t_s / LAP_S * 100) % 2
    columns = stamp_noise(_sampling(), T_S, np.stack([steps, steps], axis=1))
    assert columns.shape[1] == GRID // 16
