from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from analysis.diagnosis.fit.leave_out import UNDECIDED, LeaveOut
from analysis.diagnosis.fit.selection import Selection
from analysis.diagnosis.fit.selection_state import SelectionState
from rigs.effects import Backlash, JointOffset, TransmissionError
from tests.support.diagnosis_cells import healthy, healthy_columns, holding, shown_by, white

PLAY, GEAR = Backlash(axis=1, width_deg=0.05), TransmissionError(axis=2, order=8, amplitude_deg=0.004)
ABSENT = JointOffset(axis=3, offset_deg=0.0001)


@cache
def _left_out() -> LeaveOut:
    linear = holding(healthy(), white(healthy(), 5) + shown_by(healthy(), [PLAY, GEAR]))
    selection = Selection(linear, healthy_columns())
    return LeaveOut(selection, selection.initial_state((PLAY, GEAR, ABSENT)), selection.causes)


def _factored_again(places: tuple[int, ...]) -> SelectionState:
    selection, state = _left_out().selection, _left_out().state
    kept = [k for k in range(len(state.effects)) if k not in places]
    refined = state.refined.only(kept)
    refined = replace(refined, residual=selection.linear.residual(refined.effects))
    return replace(state, refined=refined, origins=tuple(state.origins[k] for k in kept))


@pytest.mark.parametrize("places", [(), (0,), (1,), (0, 1), (0, 1, 2)])
def test_evidence_without_effects_equals_that_of_a_new_factor(places):
    selection, reduced = _left_out().selection, _left_out().without(places)
    bare = _factored_again(places)
    assert reduced.evidence == pytest.approx(selection.evidence(bare), abs=1e-3)
    gains = selection.causes.gains(selection.posterior(bare))
    assert set(reduced.cause_gains) == set(gains)
    for kind, gain in gains.items():
        np.testing.assert_allclose(reduced.cause_gains[kind], gain, atol=1e-3)


@pytest.mark.parametrize("places", [(), (0,), (1,), (0, 1), (0, 1, 2)])
def test_coefficients_without_effects_equal_those_of_a_new_factor(places):
    selection, bare = _left_out().selection, _factored_again(places)
    reduced, again = _left_out().coefficients_without(places), selection.posterior(bare)
    of_forms, end = selection.columns.forms, selection.columns.set_ups.start
    np.testing.assert_allclose(reduced.mean[:end], again.mean[:end], atol=1e-5)
    linear, factored = (each.gains(of_forms, bare.level) for each in (reduced, again))
    shown = factored.sigma > 0.1  # size and sign of a form that hardly shows are rounding
    np.testing.assert_allclose(*(selection.gains(bare, each)[shown] for each in (reduced, again)), atol=1e-3)
    np.testing.assert_allclose(linear.size[shown], factored.size[shown], rtol=1e-3, atol=1e-4)


def test_only_names_that_explain_little_are_fitted_again():
    left_out = _left_out()
    whole = left_out.selection.evidence(left_out.state)
    assert left_out.without([0]).evidence < whole - UNDECIDED and not left_out.is_close([0])
    assert left_out.is_close([2])


def test_leaving_out_needs_no_factor():
    left_out = _left_out()
    left_out.without([0])
    before = left_out.selection.work.factors
    for places in ([1], [2], [0, 1], [1, 2]):
        left_out.without(places)
    assert left_out.selection.work.factors == before
