"""Count of the computations of a diagnosis, which no other process on the computer changes."""

import pytest

from analysis import diagnose, load_run
from analysis.diagnosis.fit.selection import Selection
from rigs.effects import Backlash, TransmissionError
from rigs.schema.effect import name_of
from tests.support.diagnosis_cells import healthy, healthy_columns, holding, shown_by, white
from tests.support.measured_series import DATA
from tests.trials.golden.golden import CASES

pytestmark = pytest.mark.cpu_limit(300)  # the counts are the limit, also on a slow processor

USUAL = [
    Backlash(axis=2, width_deg=0.012),
    *(
        TransmissionError(axis=axis, order=order, amplitude_deg=amplitude, phase_deg=phase)
        for axis, order, amplitude, phase in ((1, 30, 0.003, 140), (2, 8, 0.004, 0), (3, 20, 0.006, 40))
    ),
]


def test_usual_effects_beside_a_fault_are_named_together():
    effects = [Backlash(axis=1, width_deg=0.2, transit=0.35), *USUAL]
    selection = Selection(holding(healthy(), white(healthy(), 12) + shown_by(healthy(), effects)), healthy_columns())
    state = selection.select(selection.initial_state())
    assert {name_of(effect) for effect in state.effects} == {name_of(effect) for effect in effects}
    assert selection.work.fits <= 25 and selection.work.factors <= 150


def test_golden_diagnosis_needs_few_fits_and_factors(tmp_path):
    (case,) = (case for case in CASES if case.name == "yaw-one-way")
    case.make(tmp_path, DATA)
    diagnosis = diagnose([load_run(run) for run in sorted((tmp_path / "runs").iterdir())])
    assert [name_of(named.effect) for named in diagnosis.effects] == ["transmission_error 4"]
    assert diagnosis.work.fits <= 10 and diagnosis.work.factors <= 70
