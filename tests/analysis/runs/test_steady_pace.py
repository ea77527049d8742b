import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis.runs import align
from analysis.runs.clocks import Instants
from analysis.runs.own_clock import numbered, through_pace

Array = np.ndarray[Any, Any]
AHEAD, EARLY = 32, 0.15


def counted_one_by_one(host_ns: Array, period_ns: float) -> Array:
    along = np.arange(len(host_ns), dtype=np.int64)
    late = host_ns - along * period_ns
    least = np.lib.stride_tricks.sliding_window_view(late, AHEAD).min(axis=1)
    missing = np.zeros(len(host_ns), dtype=np.int64)
    before = np.full(AHEAD, least[0])
    for k, ahead in enumerate(least.tolist()):
        missing[k] = math.floor((ahead - before.min()) / period_ns + EARLY)
        before[k % AHEAD] = ahead - missing[k] * period_ns
    missing[len(least) :] = missing[len(least) - 1]
    return along + np.minimum.accumulate(missing[::-1])[::-1]


@settings(max_examples=150)
@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(AHEAD, 800),
    often=st.sampled_from([0.0, 0.003, 0.05, 0.4]),
    uneven=st.sampled_from([0.0, 0.02, 0.3, 3.0]),
    held=st.sampled_from([0.0, 0.8, 3.3]),
    stalls=st.lists(st.tuples(st.floats(0, 1), st.floats(0, 6)), max_size=5),
)
def test_numbers_are_those_of_counting_one_by_one(seed, count, often, uneven, held, stalls):
    """Times in whole ns, so that no rounding decides."""
    rng, period_ns = np.random.default_rng(seed), 1000.0
    number = np.cumsum(1 + (rng.random(count) < often) * rng.integers(1, 5, count))
    host_ns = period_ns * (number + rng.exponential(uneven, count))
    for at, periods in stalls:
        host_ns[int(at * count) :] += periods * period_ns
    if held:
        host_ns = np.ceil(host_ns / (held * period_ns)) * held * period_ns
    host_ns = np.maximum.accumulate(host_ns).round()
    np.testing.assert_array_equal(numbered(host_ns, period_ns), counted_one_by_one(host_ns, period_ns))


SYLVAC_NS, QUICK_NS = 20.6e6, 0.25e6
ADAPTERS_MS = (0, 1, 16)
TOLD_S = align.WANDERS_S


def arrived(rng: np.random.Generator, sent_ns: Array, adapter_ms: float) -> Array:
    """Arrivals (n,) ns: each late by 0.1 ms or so, and held until the next tick of an adapter's timer."""
    came = 1e9 + sent_ns + rng.exponential(0.1e6, len(sent_ns))
    return np.maximum.accumulate(np.ceil(came / (adapter_ms * 1e6)) * adapter_ms * 1e6 if adapter_ms else came)


def waited(rng: np.random.Generator, period_ns: float, count: int) -> Array:
    """When a sender without a crystal of its own sends (n,) ns: it is held up now and then, and goes on from there."""
    sent = np.arange(count) * period_ns
    for at in rng.integers(count // 10, 9 * count // 10, rng.integers(1, 5)):
        sent[at:] += rng.uniform(0.1, 2.5) * period_ns
    return sent


@pytest.mark.parametrize("adapter_ms", ADAPTERS_MS)
@pytest.mark.parametrize("period_ns", [14.3e6, SYLVAC_NS])
def test_crystal_keeps_its_pace_through_gaps_and_stalls(period_ns, adapter_ms):
    """Readings that arrive late and together were taken in time. Missing readings among them, or next to a gap, cannot
    be
    identified if the adapter delays messages by more than their period.
    """
    rng = np.random.default_rng(11)
    for lost, stalls in ((0, 0), (6, 0), (0, 3), (6, 3)):
        number = np.sort(rng.choice(np.arange(1, 1200), 1199 - lost, replace=False))
        sent = taken = number * period_ns
        for begin in rng.choice(taken[100:-100], stalls, replace=False):
            sent = np.where((sent > begin) & (sent < begin + 200e6), begin + 200e6, sent)
        found = through_pace(arrived(rng, sent, adapter_ms))
        right = np.abs(found.ns - 1e9 - taken)[:-AHEAD] < max(0.6e6, 2e9 * found.shared_u_s)
        assert right.mean() > (0.98 if lost else 1 - 1e-9), (lost, stalls)
        assert found.wanders_s < TOLD_S and found.shared_u_s < 1e-3, (lost, stalls)


@pytest.mark.parametrize("adapter_ms", ADAPTERS_MS)
@pytest.mark.parametrize("period_ns", [14.3e6, SYLVAC_NS])
def test_an_instrument_that_waited_is_timed_by_its_arrivals_and_doubted(period_ns, adapter_ms):
    """One of 25 runs may hide so short a wait that nobody sees it."""
    within, told = [], 0
    for seed in range(10):
        rng = np.random.default_rng(seed)
        taken = waited(rng, period_ns, 1000)
        found = through_pace(arrived(rng, taken, adapter_ms))
        error_s = np.abs(found.ns - 1e9 - taken)[:-AHEAD] / 1e9
        within.append(np.mean(error_s < 2 * np.hypot(np.hypot(found.u_s[:-AHEAD], found.shared_u_s), 0.3e-3)))
        told += found.wanders_s > TOLD_S
    assert np.mean(within) > 0.9
    assert told >= 7


def test_unsteady_pace_is_reported():
    doubts = [
        doubt
        for wanders_s in (0.0, 0.5 * TOLD_S, 5.24e-3)
        for doubt in align.timing_doubts("g1", Instants(np.empty(0), 0.0, np.empty(0), wanders_s=wanders_s))
    ]
    (doubt,) = doubts
    assert doubt.startswith("g1:") and " 5.2 ms" in doubt
