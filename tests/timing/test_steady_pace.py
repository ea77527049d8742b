"""Messages of a steady pace without a clock: their numbers, held against counting them one by one."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis.reading.steady_pace import numbered

Array = np.ndarray[Any, Any]
AHEAD, EARLY = 32, 0.15


def counted_one_by_one(host_ns: Array, period_ns: float) -> Array:
    """What `numbered` says, row after row."""
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


@settings(max_examples=150, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(AHEAD, 800),
    often=st.sampled_from([0.0, 0.003, 0.05, 0.4]),
    uneven=st.sampled_from([0.0, 0.02, 0.3, 3.0]),
    held=st.sampled_from([0.0, 0.8, 3.3]),
    stalls=st.lists(st.tuples(st.floats(0, 1), st.floats(0, 6)), max_size=5),
)
def test_numbers_are_those_of_counting_one_by_one(
    seed: int, count: int, often: float, uneven: float, held: float, stalls: list[tuple[float, float]]
) -> None:
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


@settings(max_examples=50, deadline=None)
@given(st.lists(st.integers(0, 4000), min_size=AHEAD, max_size=300), st.integers(1, 3000))
def test_numbers_of_no_pace_at_all_too(steps_ns: list[int], period_ns: int) -> None:
    host_ns = np.cumsum(steps_ns).astype(float)
    np.testing.assert_array_equal(numbered(host_ns, period_ns), counted_one_by_one(host_ns, period_ns))
