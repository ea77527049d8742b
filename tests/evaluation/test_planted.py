"""Planted and recovered: every reported figure within twice its uncertainty as often as that says."""

import pytest
from planted import CASES, SEEDS, within


@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", CASES)
def test_planted_is_recovered_within_2u(name: str) -> None:
    """90 to 99 of 100 are wanted; from 88 up is chance (binomial), and 100 of a few figures is too."""
    counts = within(CASES[name]())
    print(counts)
    low = {figure: count for figure, count in counts.items() if count < 0.88 * SEEDS}
    assert not low, low
    assert sum(count == SEEDS for count in counts.values()) <= len(counts) // 2, counts
