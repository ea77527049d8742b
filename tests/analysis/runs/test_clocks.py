from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.optimize import nnls

from analysis.runs import clocks
from analysis.runs.own_clock import floor, highest_under, lower_line, through_clock, through_pace

Array = np.ndarray[Any, Any]
LEAST_MS = 0.2


def arrivals(rng: np.random.Generator, taken_s: Array) -> Array:
    """(n,) ns of messages in order, each late by LEAST_MS and more."""
    late_ms = LEAST_MS + rng.exponential(5.0, len(taken_s))
    return np.maximum.accumulate(taken_s * 1e9 + late_ms * 1e6)


def error_ms(ns: Array, taken_s: Array) -> Array:
    """Beyond the least delay, which nobody can see."""
    return np.abs(ns - taken_s * 1e9) / 1e6 - LEAST_MS


def run(seconds: float = 40.0, rate_hz: float = 125.0, ppm: float = 30.0) -> tuple[Array, Array, Array]:
    """True times (n,) s, the controller's clock (n,) s, arrivals (n,) ns."""
    taken_s = np.arange(0, seconds, 1 / rate_hz)
    return taken_s, 1000 + taken_s * (1 + ppm * 1e-6), arrivals(np.random.default_rng(3), taken_s)


def test_a_drifting_clock_behind_jitter_is_read_to_a_twentieth_of_a_millisecond():
    taken_s, clock_s, host_ns = run()
    fitted = through_clock(clock_s, host_ns)
    assert error_ms(fitted.ns, taken_s).max() < 0.05
    assert error_ms(host_ns, taken_s).max() > 10
    assert (fitted.restarts, fitted.wrong) == (0, 0) and not fitted.u_s.any()


@pytest.mark.parametrize("off_s", [0.05, 500.0, -0.9])
def test_wrong_stamps_are_counted_and_drag_nothing(off_s):
    taken_s, clock_s, host_ns = run()
    wrong = [500, 1700, 1702, 4000]
    clock_s[wrong] += off_s
    fitted = through_clock(clock_s, host_ns)
    assert (fitted.restarts, fitted.wrong) == (0, len(wrong))
    others = np.delete(np.arange(len(taken_s)), wrong)
    assert np.abs(error_ms(fitted.ns, taken_s))[others].max() < 0.05
    assert np.abs(error_ms(fitted.ns, taken_s))[wrong].max() < 60
    assert (fitted.u_s[wrong] > 2e-3).all() and not fitted.u_s[others].any()


def test_restarted_clock_is_fitted_in_pieces():
    taken_s, clock_s, host_ns = run()
    clock_s[3000:] -= clock_s[3000]
    fitted = through_clock(clock_s, host_ns)
    assert fitted.restarts == 1 and error_ms(fitted.ns, taken_s).max() < 0.1


@pytest.mark.parametrize("wrap_s", [2**32 * 1e-3, 2**32 * 1e-6])
@pytest.mark.parametrize("signed", [False, True])
def test_wrapped_32_bit_counter_continues(wrap_s, signed):
    taken_s, clock_s, host_ns = run()
    wrapped = (clock_s - clock_s[0] + wrap_s - 20) % wrap_s - (wrap_s / 2 if signed else 0)
    fitted = through_clock(wrapped, host_ns)
    assert fitted.restarts == fitted.wrong == 0 and error_ms(fitted.ns, taken_s).max() < 0.05


def test_a_clock_whose_rate_follows_the_temperature_is_followed():
    """Half an hour, the rate swinging by 1 ppm in 20 minutes."""
    taken_s = np.arange(0, 1800, 0.05)
    wander_s = 1e-6 * 1200 / (2 * np.pi) * np.cos(2 * np.pi * taken_s / 1200)
    host_ns = arrivals(np.random.default_rng(4), taken_s)
    clock_s = taken_s * (1 + 30e-6) + wander_s
    straight, _ = floor(clock_s, host_ns / 1e9 - clock_s, window=1e9)
    broken, _ = floor(clock_s, host_ns / 1e9 - clock_s)
    error_us = [np.abs(clock_s + line - taken_s - LEAST_MS / 1e3).max() * 1e6 for line in (broken, straight)]
    assert error_us[0] < 40
    assert error_us[1] > 150


@settings(max_examples=60)
@given(st.lists(st.floats(0, 100), min_size=2, max_size=60), st.integers(0, 2**32 - 1))
def test_the_line_lies_under_all_points_and_no_other_lies_closer(ys, seed):
    x, y = np.arange(len(ys), dtype=float), np.array(ys)
    offset, slope = lower_line(x, y)
    assert (y - offset - slope * x).min() > -1e-9 * 100
    for other in np.random.default_rng(seed).normal(slope, 1 + abs(slope), 20):
        under = (y - other * x).min()
        assert under + other * x.mean() <= offset + slope * x.mean() + 1e-7


@pytest.mark.parametrize("knots", [3, 21, 200])
def test_no_line_of_so_many_pieces_lies_higher_under_the_corners(knots):
    """The pull of each knot is a sum, with no negative weight, of the corners that the line touches (Farkas)."""
    rng = np.random.default_rng(knots)
    right = np.sort(rng.integers(1, knots, 20 * knots))
    share, corners = rng.uniform(0, 1, len(right)), 1e-3 * (np.sin(right / 5) + rng.exponential(1, len(right)))
    pull = np.bincount(right, share, knots) + np.bincount(right - 1, 1 - share, knots)
    heights = highest_under(pull, right, share, corners)
    at_corners = np.zeros((len(right), knots))
    at_corners[np.arange(len(right)), right - 1], at_corners[np.arange(len(right)), right] = 1 - share, share
    below = corners - at_corners @ heights
    assert below.min() > -1e-9 * np.ptp(corners)
    assert nnls(at_corners[below < 1e-9].T, pull)[1] < 1e-6


@pytest.mark.parametrize(("held_ms", "beyond_s"), [(16, 0.272), (60, 0.216)])
def test_behind_an_adapter_that_holds_bytes_back_only_a_computer_held_up_makes_a_row_uncertain(held_ms, beyond_s):
    window = 3e6 + np.random.default_rng(1).uniform(0.0, held_ms * 1e6, 400)
    window[:2] = 3e6
    window[200] = 300e6
    found = clocks.asked_instants(np.arange(400) * 20e6, window, held=True)
    assert np.count_nonzero(found.own_u_s) == 1 and found.own_u_s[200] == pytest.approx(
        beyond_s / np.sqrt(12), rel=0.02
    )
    assert found.ns[100] == 100 * 20e6 + 1.5e6 and found.held


def test_without_a_steady_pace_the_arrivals_stay():
    rng = np.random.default_rng(9)
    host_ns = np.cumsum(rng.uniform(10e6, 30e6, 1500))
    found = through_pace(host_ns)
    np.testing.assert_array_equal(found.ns, host_ns)
    assert 2e-3 < np.median(found.u_s) < 5e-3  # they may be late by as much as they are uneven


@example(4, 70, 4, 20)
@settings(max_examples=60)
@given(st.integers(0, 80), st.integers(0, 80), st.integers(0, 80), st.integers(1, 50))
def test_messages_that_come_all_at_once_after_a_stall_are_no_pace(before, burst, after, ms):
    steps_ns = np.concatenate([np.full(before, ms * 1e6), np.zeros(burst), np.full(after, ms * 1e6)])
    host_ns = 1e9 + np.cumsum(steps_ns)
    found = through_pace(host_ns)
    assert found.ns.shape == host_ns.shape and np.isfinite(found.ns).all() and np.isfinite(found.u_s).all()
