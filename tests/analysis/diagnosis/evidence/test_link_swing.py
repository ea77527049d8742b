"""A swing that begins anew with every run is found by what all runs share, its frequency; noise has none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.evidence.link_swing import FoundVibration, find_vibration
from analysis.diagnosis.evidence.setups import fit_run_setups
from analysis.diagnosis.judge.judge import named_vibration
from analysis.runs.loading import Measured
from analysis.runs.tables import CircleTable
from rigs.effects import swing as vibration_at
from tests.support.diagnosis_cells import RIG, circles, measured, response, seen, table_of
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


def _one_lap(run: Measured) -> Measured:
    """The first half of a run of two laps."""
    table = run.table
    assert isinstance(table, CircleTable)
    half = slice(0, len(table.t_s) // 2)
    return replace(run, table=replace(table, t_s=table.t_s[half], q=table.q[half], g_mm=table.g_mm[half]))


@pytest.mark.parametrize("seed", [1, 90])
def test_noise_does_not_swing(seed: int) -> None:
    found = _swing(circles(seed=seed))
    assert found and found.gain < SURE


@pytest.mark.parametrize(
    ("odds", "amplitude_mm", "doubts"),
    [(15.0, 0.1, []), (25.0, 0.1, [None]), (25.0, 0.008, ["usual"]), (25.0, 0.0105, ["unsure"]), (25.0, 0.001, [])],
)
def test_a_vibration_is_a_fault_by_odds_and_size(odds: float, amplitude_mm: float, doubts: list[str | None]) -> None:
    """Vibrations of up to five times the healthy 0.002 mm are usual."""
    sd = {"amplitude_mm": 0.001, "frequency_hz": 0.01}
    found = FoundVibration(vibration_at(15.8, amplitude_mm), amplitude_mm, sd, float(np.log(odds)))
    assert [named.doubt for named in named_vibration(found, RIG.reference, 1.0)] == doubts


def test_targets_do_not_swing() -> None:
    assert _swing([measured(table_of("radial", None, 1), "radial", "radial")]) is None
