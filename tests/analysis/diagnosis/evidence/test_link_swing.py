import numpy as np
import pytest

from analysis.diagnosis.evidence.link_swing import FoundVibration, find_vibration
from analysis.diagnosis.evidence.setups import fit_run_setups
from analysis.diagnosis.judge.judge import named_vibration
from analysis.runs.loading import Measured
from rigs.effects import swing as vibration_at
from tests.support.diagnosis_cells import RIG, circles, response, seen

SURE = 7.0
"""Log evidence that any name must win (its price and the number of names)."""


def _swing(runs: list[Measured]) -> FoundVibration | None:
    them = seen(runs)
    return find_vibration(them, fit_run_setups(them)[0])


@pytest.mark.parametrize(("frequency_hz", "amplitude_mm"), [(15.05, 0.001), (3.1, 0.01)])
def test_a_planted_swing_is_found(frequency_hz, amplitude_mm):
    phases = np.random.default_rng(1).uniform(0, 2 * np.pi, 4)
    runs = [response(run, frequency_hz, amplitude_mm, phase) for run, phase in zip(circles(), phases, strict=True)]
    found = _swing(runs)
    assert found.gain > SURE
    assert found.effect.frequency_hz == pytest.approx(frequency_hz, abs=max(0.02, 3 * found.sd["frequency_hz"]))
    assert found.effect.amplitude_mm == pytest.approx(amplitude_mm, abs=4 * found.sd["amplitude_mm"], rel=0.1)


def test_noise_does_not_swing():
    found = _swing(circles())
    assert found.gain < SURE


@pytest.mark.parametrize(
    ("odds", "amplitude_mm", "doubts"),
    [(15.0, 0.1, []), (25.0, 0.1, [None]), (25.0, 0.008, ["usual"]), (25.0, 0.0105, ["unsure"]), (25.0, 0.001, [])],
)
def test_a_vibration_is_a_fault_by_odds_and_size(odds, amplitude_mm, doubts):
    sd = {"amplitude_mm": 0.001, "frequency_hz": 0.01}
    found = FoundVibration(vibration_at(15.8, amplitude_mm), amplitude_mm, sd, float(np.log(odds)))
    assert [named.doubt for named in named_vibration(found, RIG.reference, 1.0)] == doubts
