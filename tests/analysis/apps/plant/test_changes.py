"""Detection of changes over time: real changes are dated, and scatter between runs is not reported."""

import numpy as np
import pytest

from analysis.apps.plant.changes import Trend, trend_of
from analysis.robot.kinematics.arm import Array

SERIES = 30
"""As many as a robot has."""


def scatter(seed: int, count: int) -> Array:
    """Heavy tails and a slow part that runs have in common."""
    rng = np.random.default_rng(seed)
    slow = np.convolve(rng.standard_normal(count + 6), np.ones(7) / np.sqrt(7), "valid")
    return rng.standard_t(5, count) + 0.5 * slow


def trend(values: Array, u: float = 0.5) -> Trend:
    return trend_of(values, np.full(len(values), u), SERIES)


def found(values: Array) -> list[tuple[int, int]]:
    return [(one.first, one.last) for one in trend(values).changes]


@pytest.mark.parametrize("count", [12, 80, 300])
def test_runs_that_only_scatter_have_no_change(count):
    assert [found(scatter(seed, count)) for seed in range(20)].count([]) >= 19


def test_a_step_is_found_at_its_run_with_both_levels():
    values = scatter(1, 120) + 8.0 * (np.arange(120) >= 70)
    (change,) = trend(values).changes
    assert change.first == pytest.approx(69, abs=1) and change.last == pytest.approx(70, abs=1)
    assert change.before == pytest.approx(0, abs=1) and change.after == pytest.approx(8, abs=1)
    assert 0.05 < change.u < 1 and change.chance < 1e-6 and not change.is_last


def test_two_steps_are_both_found():
    values = scatter(2, 150) + 8.0 * (np.arange(150) >= 50) - 10.0 * (np.arange(150) >= 100)
    first, second = found(values)
    assert first == pytest.approx((49, 50), abs=1) and second == pytest.approx((99, 100), abs=1)


def test_slow_growth_has_its_begin_and_goes_on():
    values = scatter(3, 200) + 12.0 * np.clip((np.arange(200) - 100) / 99, 0, 1)
    (change,) = trend(values).changes
    assert 85 <= change.first <= 115 and change.last >= 180
    assert change.after - change.before == pytest.approx(12, abs=3)


def test_step_is_found_if_most_runs_repeat_a_value():
    """As ranges that are floored at zero do, and figures of gauges with coarse steps."""
    stepped = np.repeat([0.01, 0.05], 20)
    assert found(100 * stepped) == [(19, 20)]
    rounded = np.round(scatter(5, 60) / 3 + 8.0 * (np.arange(60) >= 40)) // 4 * 4
    (change,) = found(rounded)
    assert change == pytest.approx((39, 40), abs=1)
    assert trend(stepped, 0.003).spread == 0
    assert not trend(stepped, 0).changes  # where nobody knows how well a run is known


def test_a_few_small_values_among_zeros_are_no_change():
    rng = np.random.default_rng(5)
    floored = np.maximum(rng.normal(-1.6, 1.0, (40, 60)), 0.0)
    assert [trend(one).changes for one in floored].count(()) >= 39


@pytest.mark.parametrize("u", [0.0, 0.05, 0.2, 1.0])
def test_values_read_in_two_steps_are_no_change(u):
    rounded = np.round(np.random.default_rng(7).normal(0.5, 0.5, (60, 30)))
    assert [trend(one, u).changes for one in rounded].count(()) >= 59


@pytest.mark.parametrize("wild", [[40], [40, 41], [0], [79], [10, 30, 60]])
def test_wild_runs_are_no_change_and_are_named(wild):
    values = scatter(4, 80)
    values[wild] += 40.0
    seen = trend(values)
    assert not seen.changes and seen.wild[wild].all() and seen.wild.sum() <= len(wild) + 3


def test_a_wild_run_does_not_hide_a_step():
    values = scatter(5, 80) + 9.0 * (np.arange(80) >= 40)
    values[55] += 60.0
    (one,) = found(values)
    assert one == pytest.approx((39, 40), abs=1)


@pytest.mark.parametrize("values", [[], [1.0], [1.0, 2.0, 9.0, 9.0, 9.0], [3.0] * 50])
def test_too_few_or_equal_runs_have_no_change(values):
    assert found(np.array(values)) == []


def test_more_figures_make_each_harder_to_believe():
    values = scatter(6, 60) + 4.0 * (np.arange(60) >= 30)
    alone = trend_of(values, np.full(60, 0.5), 1).changes
    among_many = trend_of(values, np.full(60, 0.5), 10_000).changes
    assert len(alone) == 1 and len(among_many) <= 1
    assert not among_many or among_many[0].chance > alone[0].chance


def test_the_spread_is_that_between_runs_and_not_of_the_change():
    values = np.random.default_rng(7).standard_normal(300) + 50.0 * (np.arange(300) >= 150)
    assert trend(values).spread == pytest.approx(1.0, rel=0.2)
