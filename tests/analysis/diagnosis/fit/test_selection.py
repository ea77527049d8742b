from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.evidence.blocks import blocks_of
from analysis.diagnosis.evidence.setups import fit_run_setups
from analysis.diagnosis.fit.candidates import Level, candidates_for, columns_for
from analysis.diagnosis.fit.responses import linearise
from analysis.diagnosis.fit.rivals import Rivals
from analysis.diagnosis.fit.search import search
from analysis.diagnosis.fit.selection import Selection
from analysis.diagnosis.fit.selection_state import SelectionState, is_one
from analysis.diagnosis.fit.starting_effects import starting_effects
from rigs.effects import Backlash, Effect, JointOffset, ReversalSpike, ServoLag, TransmissionError
from rigs.schema.effect import name_of, scaled, size_of
from tests.support.diagnosis_cells import (
    Array,
    circles,
    healthy,
    healthy_columns,
    holding,
    poses,
    seen,
    shown_by,
    white,
)


def _searched(y: Array) -> tuple[Selection, SelectionState]:
    selection = Selection(holding(healthy(), y), healthy_columns())
    return selection, selection.select(selection.initial_state())


def _found(state: SelectionState) -> dict[str, Effect]:
    return {name_of(effect): effect for effect in state.effects}


def test_nothing_is_found_in_noise():
    _, state = _searched(white(healthy(), 11))
    assert state.effects == () and state.unknown == ()
    assert state.level.values.max() < 0.1  # an arm without effects is far below a healthy one


def test_a_fault_is_found_in_its_form_and_has_no_rival():
    truth = Backlash(axis=1, width_deg=0.2, transit=0.35)
    selection, state = _searched(white(healthy(), 12) + shown_by(healthy(), [truth]))
    found = _found(state)["backlash 1"]
    place = state.effects.index(found)
    assert state.may_be_fault(place) and size_of(found) == pytest.approx(20, rel=0.05)
    assert found.transit == pytest.approx(0.35, abs=0.1)
    one = Rivals(selection, state).odds(place)
    assert one.odds > 0.99 and one.healthy_odds < 1e-6


def test_faults_whose_shapes_are_local_optima_are_fitted_again():
    truths = [ReversalSpike(axis=axis, amplitude_deg=0.3, decay_s=0.18, slow=0.05, rise=0.03) for axis in (2, 3)]
    selection = Selection(holding(healthy(), white(healthy(), 12) + shown_by(healthy(), truths)), healthy_columns())
    begun = [ReversalSpike(axis=axis, amplitude_deg=0.45, decay_s=0.05, slow=0.8, rise=0.15) for axis in (2, 3)]
    state = selection.initial_state(begun)
    again = selection.fitted_again(state)
    assert set(_found(again)) == set(_found(state)) == {"reversal_spike 2", "reversal_spike 3"}
    assert selection.evidence(again) > selection.evidence(state) + 100
    for name, held in _found(state).items():
        assert held.slow > 0.6  # its quick part and its slow one are exchanged
        assert _found(again)[name].decay_s == pytest.approx(0.18, rel=0.02)
        assert _found(again)[name].amplitude_deg == pytest.approx(0.3, rel=0.01)


def test_waves_of_other_orders_are_not_one_however_near():
    wave = TransmissionError(axis=1, order=20, amplitude_deg=0.01)
    assert is_one(wave, wave.model_copy(update={"order": 20.3, "amplitude_deg": 0.05}))
    assert not is_one(wave, wave.model_copy(update={"order": 22.0}))
    assert is_one(JointOffset(axis=2, offset_deg=0.2), JointOffset(axis=2, offset_deg=0.1))
    assert not is_one(JointOffset(axis=2, offset_deg=0.2), JointOffset(axis=3, offset_deg=0.2))


def test_target_far_from_its_fitted_place_is_no_length():
    """A target is anywhere; a last link, which moves it alike, is as long as its drawing states."""
    runs = seen([poses(1)])
    about = linearise(blocks_of(runs, fitted := fit_run_setups(runs)[0]), fitted)
    setups = about.setups_moved_by(np.eye(9)[8] * 60.0)
    linear = linearise(blocks_of(runs, setups), setups)
    selection = Selection(linear, columns_for(linear, candidates_for(linear)))
    state = selection.initial_state()
    posterior = selection.posterior(state)
    (length,) = (k for k, form in enumerate(selection.columns.forms) if form.name == "link_geometry 6.d")
    assert selection.gains(state, posterior)[length] < -2.0
    assert posterior.mean[selection.columns.set_ups][8] == pytest.approx(-60, abs=0.1)


@pytest.mark.parametrize(("level", "is_fault"), [(0.3, True), (1.0, False), (3.0, False)])
def test_a_fault_is_more_than_healthy_arms_and_arms_like_this_one_show(level, is_fault):
    selection = Selection(holding(healthy(), white(healthy(), 15)), healthy_columns())
    small, large = JointOffset(axis=2, offset_deg=0.04), JointOffset(axis=3, offset_deg=0.16)
    state = replace(selection.initial_state((small, large)), level=Level(level))
    refined = replace(state.refined, effects=(small, large))
    state = replace(state, refined=refined)
    assert (state.may_be_fault(0), state.may_be_fault(1)) == (is_fault, True)


def test_an_arm_without_faults_needs_one_search():
    said: list[str] = []
    result = search(seen(circles(seed=93)), said.append)
    assert result.effects == () and said.count("selecting effects") == 1


GEAR = TransmissionError(axis=4, order=116, amplitude_deg=0.3, phase_deg=60)
LAG = ServoLag(axis=1, lag_s=0.02)


def _beside(*known: Effect, moved_mm: float = 0.0) -> Selection:
    setups = {name: replace(one, ball=one.ball + np.array([moved_mm, 0, 0])) for name, one in healthy().setups.items()}
    runs = seen(circles(seed=90))
    return Selection(linearise(blocks_of(runs, setups, known), setups, known), healthy_columns())


def _with(*effects: Effect) -> SelectionState:
    empty = Selection(healthy(), healthy_columns()).initial_state()
    return replace(empty, level=Level(1.0), refined=replace(empty.refined, effects=effects))


def test_columns_hold_for_faults_that_hardly_changed():
    state = _with(GEAR, ServoLag(axis=2, lag_s=0.0005), LAG)
    assert _beside(LAG, GEAR).is_valid_for(state) and _beside(LAG, scaled(GEAR, 1.05)).is_valid_for(state)
    assert not _beside(LAG, scaled(GEAR, 1.2)).is_valid_for(state)
    assert not _beside(GEAR.model_copy(update={"order": 20.0}), LAG).is_valid_for(state)
    assert not _beside(GEAR).is_valid_for(state) and not _beside().is_valid_for(state)
    assert not _beside(GEAR, LAG, ServoLag(axis=3, lag_s=0.02)).is_valid_for(state)
    assert not _beside(GEAR, LAG, moved_mm=1.0).is_valid_for(state)  # set-ups that move by a millimetre
    assert _beside().is_valid_for(_with()) and not _beside(GEAR).is_valid_for(_with())


def _begun(*truth: Effect) -> tuple[Selection, SelectionState]:
    """A search before anything is named: what the faults do counts as noise as yet."""
    y = white(healthy(), 21) + shown_by(healthy(), list(truth))
    selection = Selection(holding(healthy(), y), healthy_columns())
    return selection, selection.initial_state()


def test_the_fit_of_a_play_starts_near_its_width():
    selection, state = _begun(Backlash(axis=1, width_deg=0.03, transit=0.5))
    forms = [form for form in healthy_columns().forms if form.name == "backlash 1"]
    assert forms
    for form in forms:
        effects = starting_effects(selection.linear, healthy_columns(), selection.posterior(state), form)
        assert min(abs(np.log(effect.width_deg / 0.03)) for effect in effects) < 0.25


def test_a_large_wave_starts_at_its_order_also_from_the_form_of_another_that_looks_like_it():
    """Axis 3 turns by less than a quarter and is mostly near the ends of its range: in a cell of the trial order 116
    gained more than the orders beside 121, and its fit ended there."""
    selection, state = _begun(TransmissionError(axis=3, order=121, amplitude_deg=0.25, phase_deg=86))
    waves = [form for form in healthy_columns().forms if form.name == "transmission_error 3"]
    other = min(waves, key=lambda form: abs(form.effects[0].order - 116))
    assert abs(other.effects[0].order - 121) > 2.5
    effects = starting_effects(selection.linear, healthy_columns(), selection.posterior(state), other)
    assert min(abs(effect.order - 121) for effect in effects) < 1
