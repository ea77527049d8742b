"""Correlations of fitted sizes."""

import numpy as np
import pytest

from analysis.diagnosis.judge.correlations import correlations_of
from rigs.calibration import CovarianceParameter, Term, packed_factor
from rigs.effects import Backlash, JointOffset, TransmissionError
from tests.support.handmade_calibration import calibrated_model

ZERO = JointOffset(axis=2, offset_deg=0.1)
PLAY = Backlash(axis=1, width_deg=0.02)
WAVE = TransmissionError(axis=3, order=2, amplitude_deg=0.01, phase_deg=10)
FIELDS = [(0, "offset_deg"), (1, "width_deg"), (2, "amplitude_deg"), (2, "phase_deg")]


def model(root):
    terms = tuple(Term(effect=effect, times=1.0, named=True) for effect in (ZERO, PLAY, WAVE))
    parameters = tuple(CovarianceParameter(term=term, field=field) for term, field in FIELDS)
    return calibrated_model(terms=terms, parameters=parameters, factor=packed_factor(np.array(root, dtype=float)))


def test_coefficient_is_that_of_the_covariance_and_the_strongest_pair_is_first():
    found = correlations_of(model([[2, 0, 0, 0], [-3, 4, 0, 0], [0, 0, 1, 0], [0.1, 0, 0, 1]]), [ZERO, PLAY, WAVE])
    assert [(pair.first, pair.second) for pair in found] == [(ZERO, PLAY), (ZERO, WAVE), (PLAY, WAVE)]
    assert found[0].value == pytest.approx(-0.6)
    assert found[1].value == pytest.approx(0.1 / np.hypot(0.1, 1), abs=5e-4)


def test_pairs_that_the_runs_separate_are_left_out():
    rows = [[2, 0, 0, 0], [-3, 4, 0, 0], [0, 0, 1, 0], [4e-4, 0, 0, 1]]
    found = correlations_of(model(rows), [ZERO, PLAY, WAVE])
    assert [(pair.first, pair.second) for pair in found] == [(ZERO, PLAY)]


def test_effects_of_another_fit_are_left_out():
    assert correlations_of(model(np.eye(4)), [PLAY]) == ()
