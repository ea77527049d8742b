"""A swing that begins anew with every run is found by what all runs share, its frequency; noise has none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.evidence.blocks import blocks_of
from analysis.diagnosis.evidence.link_swing import FoundVibration, find_vibration
from analysis.diagnosis.evidence.setups import fit_run_setups
from analysis.diagnosis.fit.responses import linearise
from analysis.diagnosis.judge.named_swing import doubts_of_phases, named_vibration
from analysis.diagnosis.judge.result import Named
from analysis.runs.loading import Measured
from analysis.runs.tables import CircleTable
from rigs.effects import swing as vibration_at
from tests.support.diagnosis_cells import circles, measured, response, scatter_um, seen, table_of
from tests.support.nightly import cases

SURE = 7.0
"""Log evidence that any name must win (its price and the number of names)."""


def _swing(runs: list[Measured]) -> FoundVibration | None:
    them = seen(runs)
    return find_vibration(them, fit_run_setups(them)[0])


@pytest.mark.parametrize(("frequency_hz", "amplitude_mm"), [(7.3, 0.004), (15.05, 0.001), (3.1, 0.01)])
def test_a_planted_swing_is_found(frequency_hz: float, amplitude_mm: float) -> None:
    phases = np.random.default_rng(1).uniform(0, 2 * np.pi, 4)
    runs = [response(run, frequency_hz, amplitude_mm, phase) for run, phase in zip(circles(), phases, strict=True)]
    found = _swing(runs)
    assert found and found.gain > SURE
    assert found.effect.frequency_hz == pytest.approx(frequency_hz, abs=max(0.02, 3 * found.sd["frequency_hz"]))
    assert found.effect.amplitude_mm == pytest.approx(amplitude_mm, abs=4 * found.sd["amplitude_mm"], rel=0.1)


@pytest.mark.parametrize(
    ("frequency_hz", "count"),
    cases([(hz, count) for hz in (7.1, 7.2, 12.05) for count in (2, 3)], [(7.1, 2), (12.05, 3)]),
)
def test_the_mean_of_repeats_also_averages_laps(frequency_hz: float, count: int) -> None:
    """Two laps of a run meet a vibration at two phases, and their mean keeps 0.3, 0.5 and nothing of its power."""
    rng = np.random.default_rng(3)
    for _ in range(3):
        runs = [response(run, frequency_hz, 0.01, rng.uniform(0, 2 * np.pi)) for run in circles(count=count)]
        found = _swing(runs)
        assert found and found.effect.amplitude_mm == pytest.approx(0.01, rel=0.03)
        assert found.effect.frequency_hz == pytest.approx(frequency_hz, abs=0.002)


def test_where_laps_have_the_same_phase_the_average_over_runs_is_right() -> None:
    """One lap a run: nothing shows what all repeats have in common, so the stated uncertainty is that of the phases."""
    rng, errors = np.random.default_rng(4), []
    for _ in range(20):
        runs = [response(_one_lap(run), 5.0, 0.01, rng.uniform(0, 2 * np.pi)) for run in circles(count=2)]
        found = _swing(runs)
        assert found
        errors.append((found.amplitude_mm - 0.01) / found.sd["amplitude_mm"])
    assert 0.5 < np.sqrt(np.mean(np.square(errors))) < 1.5


def test_a_swing_that_begins_with_the_program_is_found_whole() -> None:
    """Its phase differs by a twentieth of a turn from run to run, so that deviations from their mean show little."""
    for seed in (5, 6):
        phases = 1.0 + np.random.default_rng(seed).normal(0.0, 0.3, 4)
        runs = [response(run, 7.5, 0.02, phase) for run, phase in zip(circles(), phases, strict=True)]
        swing = _swing(runs)
        assert swing and swing.effect.frequency_hz == pytest.approx(7.5, abs=0.05)
        assert abs(swing.amplitude_mm - 0.02) < 2 * swing.sd["amplitude_mm"], swing
        assert swing.sd["amplitude_mm"] < 0.004
        assert swing.may_follow_angle  # a path error of the controller has the same phase in every run, too


def _one_lap(run: Measured) -> Measured:
    """The first half of a run of two laps."""
    table = run.table
    assert isinstance(table, CircleTable)
    half = slice(0, len(table.t_s) // 2)
    return replace(run, table=replace(table, t_s=table.t_s[half], q=table.q[half], g_mm=table.g_mm[half]))


@pytest.mark.parametrize("frequency_hz", cases((3.7, 7.2, 9.1), (7.2,)))
def test_a_vibration_states_what_it_adds_to_the_scatter_of_runs(frequency_hz: float) -> None:
    """The laps of a run are averaged, which takes a part of it; the scatter of the runs shows what is left."""
    rng = np.random.default_rng(8)
    runs = [response(run, frequency_hz, 0.03, rng.uniform(0, 2 * np.pi)) for run in circles(count=4)]
    shown = _scatter_um(runs) ** 2 - _scatter_um(circles(count=4)) ** 2
    found = _swing(runs)
    assert found
    (found_um,) = found.scatter_um.values()
    assert found_um**2 == pytest.approx(shown, rel=0.15)


def _scatter_um(runs: list[Measured]) -> float:
    them = seen(runs)
    setups, _ = fit_run_setups(them)
    return float(scatter_um(linearise(blocks_of(them, setups), setups))[0])


@pytest.mark.parametrize("seed", [1, 90])
def test_noise_does_not_swing(seed: int) -> None:
    found = _swing(circles(seed=seed))
    assert found and found.gain < SURE


@pytest.mark.parametrize(("odds", "count"), [(15.0, 0), (25.0, 1)])
def test_a_swing_is_a_name_only_with_odds_of_20_to_1(odds: float, count: int) -> None:
    """Also with zero tolerance, for which the smallest swing would matter."""
    found = FoundVibration(vibration_at(15.8, 1e-4), 1e-4, {}, float(np.log(odds)), {})
    assert len(named_vibration(found, np.zeros(2), 1.0)) == count


@pytest.mark.parametrize(
    ("left_mm", "gain", "is_doubted"),
    [(0.0275, 50.0, True), (0.002, 50.0, False), (0.0275, 1.0, False)],
    ids=["left", "within-u", "no-vibration"],
)
def test_a_fitted_vibration_is_doubted_by_what_swings_on_once_it_is_taken_off(
    left_mm: float, gain: float, is_doubted: bool
) -> None:
    """Of 0.0277 mm with a phase of each run's own a fit with one phase left all, and stated 0.0000 ± 0.0007 mm."""
    fitted = Named(vibration_at(6.92, 0.0), {"amplitude_mm": 0.0007}, 1.0, (), 0.0, "", 0.0, None)
    sd = {"amplitude_mm": 0.0003, "frequency_hz": 0.01}
    doubts = doubts_of_phases([fitted], FoundVibration(vibration_at(6.92, left_mm), left_mm, sd, gain, {}))
    assert len(doubts) == is_doubted
    if doubts:
        assert "0.0275 ± 0.0003 mm" in doubts[0] and "6.92 Hz" in doubts[0]


def test_targets_do_not_swing() -> None:
    assert _swing([measured(table_of("radial", None, 1), "radial", "radial")]) is None
