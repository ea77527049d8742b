"""Planted and recovered: every reported figure within twice its uncertainty as often as that says, and not by a wide u.

`scripts/dev planted` scores many more cells, kinds of noise and laps.
"""

import numpy as np
import pytest

from tests.support.made_once import made_once
from tests.trials.planted.score import TABLE, Job, Point, points_of, report, scores_of

FIRST = 1000
CELLS = {("yaw", "white"): 2, ("roll", "white"): 3, ("radial", "alike"): 12, ("repeatability", "alike"): 12}
CELLS |= {("pose", "tracker alone"): 12}
"""Number of cells by test and kind of noise; cells with two runs and their pair are slow."""


@made_once
def _points(test: str, kind: str) -> tuple[Point, ...]:
    seeds = range(FIRST, FIRST + CELLS[test, kind])
    return tuple(point for seed in seeds for point in points_of(Job(test, kind, seed, laps=2, rows=720)))


def _sound(points: tuple[Point, ...]) -> bool:
    """Few cells, so all figures together: of errors that are normal with u as their standard deviation 95 % lie within
    2 u and half within 0.67 u."""
    there = [point for point in points if np.isfinite(point.error) and point.noise != "assumed"]
    with np.errstate(divide="ignore", invalid="ignore"):  # a place on a grid may be known exactly
        off = np.nan_to_num(np.abs([point.error for point in there]) / [point.u for point in there], posinf=np.inf)
    return bool(np.mean(off <= 2) >= 0.85 and 0.27 < np.median(off) < 0.95)


@pytest.mark.parametrize(("test", "kind"), CELLS)
def test_planted_is_recovered_within_2u(test, kind):
    points = _points(test, kind)
    print(report(scores_of(points), repeated=True))
    assert _sound(points)


def _drawn(u: float, bias: float = 0.0, noise: str = "measured", count: int = 600) -> list[Point]:
    errors = np.random.default_rng(4).normal(bias, 1.0, count)
    return [Point("yaw", "band_deg", TABLE, float(error), u, noise) for error in errors]


@pytest.mark.parametrize(
    ("points", "fault"),
    [
        (_drawn(1.0), ""),
        (_drawn(1 / 3), "% within 2 u"),
        (_drawn(3.0), "u 3.0 times"),
        (_drawn(1.2, bias=0.6), "bias +0.5"),
        (_drawn(1.0, bias=0.6, noise="assumed"), ""),
        ([Point("yaw", "band_deg", TABLE, np.nan, np.nan, "")], ""),
    ],
)
def test_rules_detect_wrong_figures(points, fault):
    (score,) = scores_of(points)
    faults = "; ".join(score.faults(repeated=True))
    assert fault in faults if fault else not faults


def test_runs_that_are_repeated_become_a_mean_with_its_uncertainty():
    points = [point for seed in range(FIRST, FIRST + 2) for point in points_of(Job("repeated", "white", seed, 2, 720))]
    there = [point for point in points if np.isfinite(point.error)]
    assert there
    assert np.mean([abs(point.error) <= 2 * point.u for point in there]) > 0.8
