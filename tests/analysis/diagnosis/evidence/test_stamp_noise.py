from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.evidence.blocks import blocks_of
from analysis.diagnosis.evidence.noise import Repeated, RunScatter, stamp_noise
from analysis.diagnosis.evidence.observation import ORDER_OF, STAMP_SCATTER, Sampling, curve, sampling_of
from analysis.diagnosis.fit.responses import linearise
from analysis.robot.kinematics.arm import Array
from analysis.runs.loading import Measured
from rigs.effects import Backlash
from tests.support.diagnosis_cells import circles, planted, seen

LAP_S, ROWS, LAPS = 15.0, 900, 2
STEP_S = LAP_S / ROWS
T_S = STEP_S * np.arange(LAPS * ROWS)
FINE = ORDER_OF >= 60
PLAY = Backlash(axis=1, width_deg=0.5)
STILL = RunScatter(0.0, 0.0, 0.0, 0.0)


def _sampling() -> Sampling:
    return sampling_of(2 * np.pi * T_S / LAP_S, (), np.empty(0)).without_trend()


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
def test_noise_of_timestamps_follows_from_late_and_early_readings(crossed_s):
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


@pytest.mark.parametrize("waves", [1, 7, 40])
def test_a_wave_is_left_to_the_noise_of_the_orders(waves):
    wave = 0.5 * np.sin(2 * np.pi * waves * T_S / LAP_S)
    assert _columns(np.stack([wave, wave], axis=1)).shape == (len(ORDER_OF), 0)


def test_readings_with_the_same_stamp_have_no_slope():
    t_s = T_S.copy()
    t_s[100] = t_s[99]
    found = stamp_noise([_sampling()], [t_s], [_crossing(T_S)])
    assert np.isfinite(found).all() and found.shape[1]


def _scattered(size: Array) -> Repeated:
    """A thousand runs with noise of `size` (N,) mm, of what a crossing shows of stamps, and with no other scatter."""
    rng, stamps = np.random.default_rng(4), _columns(_crossing(T_S))
    noise = size * rng.standard_normal((1000, len(size)))
    none = np.zeros((len(size), 9))
    rows = noise + rng.standard_normal((1000, stamps.shape[1])) @ stamps.T
    return Repeated("yaw", rows, none, none[None], 1, stamps)


@pytest.mark.parametrize("slow_mm", [0.0003, 0.005])
def test_a_few_angles_do_not_raise_the_noise_of_all_orders(slow_mm):
    size = np.where(ORDER_OF < 8, slow_mm, 0.0003)
    noise, free = _scattered(size).noise(STILL, size)
    assert np.std(_scattered(size).deviations_mm[:, FINE]) > 5 * 0.0003
    for own in (FINE, ~FINE & (ORDER_OF >= 8), ORDER_OF < 8):
        expected = np.sqrt(np.mean(free[own] * size[own] ** 2))
        assert np.sqrt(np.mean(noise[:, own] ** 2)) == pytest.approx(expected, rel=0.03)
        assert 0.9 < free[own].mean() < 1


def _late(run: Measured, rng: np.random.Generator) -> Measured:
    table = run.table
    t_s = table.t_s + STAMP_SCATTER * np.median(np.diff(table.t_s)) * rng.standard_normal(len(table.t_s))
    g_mm = np.stack([np.interp(t_s, table.t_s, gauge) for gauge in table.g_mm.T], axis=1)
    return replace(run, table=replace(table, g_mm=g_mm))


def test_the_residual_is_no_larger_than_noise_and_stamps():
    rng, setups = np.random.default_rng(9), {"yaw": planted()}
    runs = seen([_late(run, rng) for run in circles((PLAY,), count=4)])
    linear = linearise(blocks_of(runs, setups, (PLAY,)), setups, (PLAY,))
    for rows, block in zip(linear.rows, linear.blocks, strict=True):
        own = np.concatenate([block.scatter_mm, block.stamps_mm], axis=1)
        C = np.diag(block.sd_mm**2) + own @ own.T
        assert block.y_mm @ np.linalg.solve(C, block.y_mm) < 1.3 * (rows.stop - rows.start)
        assert _energy(block.white(block.y_mm)) > 4 * (rows.stop - rows.start)
