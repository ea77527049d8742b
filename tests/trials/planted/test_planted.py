"""Planted and recovered: every reported figure within twice its uncertainty as often as that says, and not by a wide u.

`scripts/dev planted` scores many more cells, kinds of noise and laps.
"""

import dataclasses

import numpy as np
import pytest

from analysis.procedures.shared.quantity import Quantity
from analysis.robot.geometry.circle import frame_of
from analysis.robot.geometry.driven_programs import circle_of
from analysis.robot.kinematics.arm import arm_of, forward
from rigs.errors import FileError
from tests.support.made_once import made_once
from tests.trials.planted.score import CASES, TABLE, Job, Point, points_of, report, scores_of
from tests.worlds.planted.cells import DRIFT_MM_PER_S, LAP_S, SINGLE, Noise, gauge_times, noise_of
from tests.worlds.planted.circles import (
    Outcome,
    Size,
    cell_rig,
    circle_table,
    draw_set_up,
)

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


def _with_u(points: tuple[Point, ...], factor: float) -> tuple[Point, ...]:
    return tuple(dataclasses.replace(point, u=factor * point.u) for point in points)


@pytest.mark.parametrize(("test", "kind"), CELLS)
def test_planted_is_recovered_within_2u(test, kind):
    points = _points(test, kind)
    print(report(scores_of(points), repeated=True))
    assert _sound(points)


@pytest.mark.parametrize("factor", [1 / 3, 3])
@pytest.mark.parametrize(("test", "kind"), CELLS)
def test_a_wrong_u_would_not_pass(test, kind, factor):
    assert not _sound(_with_u(_points(test, kind), factor))


# --- the rules


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


def test_a_case_becomes_points(monkeypatch):
    """A place just over the seam is near; a figure left out, or without u, is missing; a refused run is a point."""
    figures = {"shift_deg": Quantity(359.5, 1.0, "deg"), "rms_deg": Quantity(1.0, np.nan, "deg")}
    truth = {"shift_deg": 0.5, "rms_deg": 1.0, "band_deg": 1.0}
    monkeypatch.setitem(CASES, "yaw", (lambda *_: {"yaw": (figures, truth)}, ()))
    shift, rms, band = points_of(Job("yaw", TABLE, 0, 2, 720))
    assert (shift.error, shift.u) == (-1.0, 1.0)
    scores = scores_of([shift, rms, band])
    assert [score.missing for score in scores] == [0, 1, 1]
    assert "yaw rms_deg (cells: 1), yaw band_deg" in report(scores, True)

    def refuse(*_: object) -> Outcome:
        raise FileError("run", "is refused", "do not")

    monkeypatch.setitem(CASES, "yaw", (refuse, ()))
    assert [point.figure for point in points_of(Job("yaw", TABLE, 0, 2, 720))] == ["(run refused)"]


# --- the cells are what they say


T_S = np.arange(20_000) * 2e-3


@pytest.mark.parametrize("slow_s", [0.3, 0.0])
def test_slow_noise_has_the_level_that_is_asked(slow_s):
    noise = Noise(white_mm=(0, 0), slow_mm=(0.003, 0.004, 0.0), slow_s=slow_s)
    rng = np.random.default_rng(1)
    power = np.mean(
        [noise_of(rng, noise, T_S).var(axis=0) + noise_of(rng, noise, T_S).mean(axis=0) ** 2 for _ in range(30)], axis=0
    )
    np.testing.assert_allclose(np.sqrt(power), [0.005, 0.003], rtol=0.2)


def test_drift_and_slip_begin_with_the_run():
    drifting = Noise(white_mm=(0, 0), drift_mm_per_s=(DRIFT_MM_PER_S, 0, 0))
    moved = noise_of(np.random.default_rng(1), drifting, T_S)
    np.testing.assert_allclose(moved[0], 0, atol=1e-12)
    assert np.ptp(moved[:, 0]) == pytest.approx(DRIFT_MM_PER_S * T_S[-1])
    slipped = noise_of(np.random.default_rng(1), Noise(white_mm=(0, 0), slip_mm=0.005), T_S)
    assert len(np.unique(slipped[:, 0].round(9))) == 2 and np.ptp(slipped[:, 0]) == pytest.approx(0.005)
    assert not slipped[0].any() and not slipped[:, 1].any()


def test_gauge_with_own_cycle_holds_its_value_and_states_the_spread():
    rng = np.random.default_rng(1)
    true_s, shown, u_t_s = gauge_times(rng, SINGLE["own cycle"], T_S)
    off_s = true_s - T_S[:, None] + SINGLE["own cycle"].lag_s
    assert np.abs(off_s).max() < 0.051 and off_s.std() == pytest.approx(u_t_s[0], rel=0.05)
    assert len(np.unique(shown[:, 0])) == pytest.approx(T_S[-1] / 0.1, abs=2)


def test_circle_table_repeats_the_rig_circle():
    rig, _ = cell_rig()
    rng = np.random.default_rng(2)
    noise, set_up = Noise(white_mm=(0, 0), step_mm=1e-9, uneven=1.0), draw_set_up(rng)
    table = circle_table(rng, set_up, noise, "yaw", "cw", Size(3, 200))
    phi = frame_of(circle_of(rig)).angle(forward(arm_of(rig.robot), table.q)[:, :3, 3])
    lead = np.radians(circle_of(rig).lead_deg)
    np.testing.assert_allclose(phi - phi[0], -2 * np.pi * (table.t_s - table.t_s[0]) / LAP_S, atol=1e-6)
    assert np.ptp(phi) == pytest.approx(6 * np.pi + 2 * lead, abs=0.05)
    np.testing.assert_allclose(table.g_mm, set_up.readings(phi, -1.0, "yaw"), atol=1e-5)


def test_runs_that_are_repeated_become_a_mean_with_its_uncertainty():
    points = [point for seed in range(FIRST, FIRST + 2) for point in points_of(Job("repeated", "white", seed, 2, 720))]
    there = [point for point in points if np.isfinite(point.error)]
    assert there
    assert np.mean([abs(point.error) <= 2 * point.u for point in there]) > 0.8
