import re
from typing import Any

import numpy as np
import pytest

from analysis.runs.own_cycle import anywhere_in_a_cycle, changes
from rigs.schema.gauges import SylvacOptoRS
from rigs.schema.probe import Timing

Array = np.ndarray[Any, Any]
MS = 1e6


def requests(poll_ms: float = 8.0, scatter: float = 0.2) -> Array:
    """Times (n,) ns of requests, as uneven as a share of their distance."""
    steps = np.random.default_rng(0).uniform(1 - scatter, 1 + scatter, int(30_000 / poll_ms))
    return np.cumsum(steps) * poll_ms * MS


def latest(asked_ns: Array, ticks_ns: Array) -> Array:
    return np.asarray(ticks_ns[np.searchsorted(ticks_ns, asked_ns, side="right") - 1])


def swing(at_ns: Array, resolution_mm: float = 1e-4, noise_mm: float = 0.0) -> Array:
    """Readings (n,) mm of a slow swing of 0.6 mm, a value for each instant however often it is asked for."""
    once, place = np.unique(at_ns, return_inverse=True)
    value = 0.6 * np.sin(2 * np.pi * once / 17.6e9) + np.random.default_rng(1).normal(0, noise_mm, len(once))
    return np.asarray(np.round(value / resolution_mm) * resolution_mm)[place]


def grid(cycle_ms: float) -> Array:
    return (np.arange(-10, int(31_000 / cycle_ms) + 10) + 0.37) * cycle_ms * MS


def test_repeated_answers_get_the_time_of_the_first_copy():
    asked = requests()
    ticks = latest(asked, grid(100.0))
    found = changes(asked, swing(ticks, noise_mm=1e-3)[:, None])
    assert found.repeating and found.usual_ns == pytest.approx(100 * MS, rel=0.02)
    ns, own_u_s = found.of_first_copies(asked)
    inside = asked > asked[0] + 200 * MS
    assert np.quantile(np.abs(ns - ticks)[inside], 0.9) < 8 * MS
    assert np.mean((np.abs(ns - ticks) <= 2e9 * own_u_s)[inside]) > 0.9


@pytest.mark.parametrize("resolution_mm", [1e-4, 1e-3, 0.01, 0.05])
def test_a_gauge_that_latches_on_request_does_not_repeat_however_coarse(resolution_mm):
    asked = requests()
    assert not changes(asked, swing(asked, resolution_mm, noise_mm=5e-4)[:, None]).repeating


def test_a_gauge_that_stops_and_goes_does_not_repeat():
    asked = requests()
    moved = np.cumsum(np.where(asked // 1e9 % 2, 0.02, 0.0))
    assert not changes(asked, np.round(moved[:, None] / 1e-3) * 1e-3).repeating


@pytest.mark.parametrize("value", [np.nan, 0.5])
def test_constant_readings_do_not_repeat(value):
    asked = requests()
    assert not changes(asked, np.full((len(asked), 2), value)).repeating


@pytest.mark.parametrize(("poll_ms", "shared"), [(20.0, True), (23.7, False)])
def test_an_age_that_all_readings_have_in_common_is_shared(poll_ms, shared):
    asked = requests(poll_ms, scatter=0.0)
    own_u_s, u_s = anywhere_in_a_cycle(asked, 10 * MS)
    assert np.hypot(own_u_s, u_s) == pytest.approx(np.full(len(asked), 10e-3 / np.sqrt(12)))
    assert (u_s > own_u_s[0]) == shared


def test_keys_that_contradict_each_other_are_refused():
    with pytest.raises(ValueError, match="own_cycle"):
        Timing(latch="on_request", cycle_ms=10)
    with pytest.raises(ValueError, match="on_request"):
        Timing(latch="own_cycle", latched_within_ms=1)
    assert re.search("100 ms.* 50 ms", str(Timing(latch="own_cycle", cycle_ms=100, filter_ms=50)))


@pytest.mark.parametrize("timing", [{"latch": "on_request"}, {"answer_delay_ms": 20.0}])
def test_a_gauge_that_sends_unasked_is_not_timed_by_a_request(timing):
    gauge = {"interface": "sylvac_opto_rs", "port": "/dev/ttyUSB0", "offset_mm": 25.0, "timing": timing}
    SylvacOptoRS.model_validate(gauge)
    with pytest.raises(ValueError, match="sends unprompted"):
        SylvacOptoRS.model_validate({**gauge, "mode": "continuous"})
