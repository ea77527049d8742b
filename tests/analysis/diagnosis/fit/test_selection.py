"""Which effects a search takes to be there: what shows in noise, in the form it has, and no more."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.evidence.blocks import blocks_of
from analysis.diagnosis.evidence.setups import fit_run_setups
from analysis.diagnosis.fit import selection_state
from analysis.diagnosis.fit.background import CoefficientPosterior
from analysis.diagnosis.fit.candidates import Level, candidates_for, columns_for
from analysis.diagnosis.fit.responses import linearise, rms_by_block
from analysis.diagnosis.fit.rivals import RivalOdds, compare_with_rivals, rival_odds
from analysis.diagnosis.fit.selection import Selection
from analysis.diagnosis.fit.selection_state import SelectionState, combined_effect, is_alike, is_duplicate, is_one
from rigs.effects import Backlash, Effect, JointOffset, ReversalSpike, TransmissionError
from rigs.schema.effect import name_of, size_of
from tests.support.diagnosis_cells import Array, healthy, healthy_columns, holding, poses, seen, shown_by, white


def _searched(y: Array) -> tuple[Selection, SelectionState]:
    selection = Selection(holding(healthy(), y), healthy_columns())
    return selection, selection.select(selection.initial_state())


def _found(state: SelectionState) -> dict[str, Effect]:
    return {name_of(effect): effect for effect in state.effects}


def test_nothing_is_found_in_noise() -> None:
    _, state = _searched(white(healthy(), 11))
    assert state.effects == () and state.unknown == ()
    assert state.level.values.max() < 0.1  # an arm without effects is far below a healthy one


def test_a_fault_is_found_in_its_form_and_has_no_rival() -> None:
    truth = Backlash(axis=1, width_deg=0.2, transit=0.35)
    selection, state = _searched(white(healthy(), 12) + shown_by(healthy(), [truth]))
    found = _found(state)["backlash 1"]
    place = state.effects.index(found)
    assert state.may_be_fault(place) and size_of(found) == pytest.approx(20, rel=0.05)
    assert getattr(found, "transit", 0.0) == pytest.approx(0.35, abs=0.1)
    one = rival_odds(selection, state, place)
    assert one.odds > 0.99 and one.healthy_odds < 1e-6


def test_nothing_is_added_to_a_series_of_waves(monkeypatch: pytest.MonkeyPatch) -> None:
    waves = [TransmissionError(axis=1, order=order, amplitude_deg=0.03, phase_deg=-70) for order in (30, 60, 100)]
    y = white(healthy(), 12) + shown_by(healthy(), waves)
    selection = Selection(holding(healthy(), y), healthy_columns())
    two = selection.initial_state(waves[:2])
    assert len(selection.select(two).refined.effects) == 3
    monkeypatch.setattr(selection_state, "_MOST_WAVES", 1)  # private: seven waves take minutes
    assert len(selection.select(two).refined.effects) == 2  # two are a series now, of which one more says nothing


def test_a_new_estimate_of_the_noise_is_not_a_gain_of_a_name(monkeypatch: pytest.MonkeyPatch) -> None:
    selection = Selection(holding(healthy(), white(healthy(), 11)), healthy_columns())
    begun = selection.initial_state()
    too_noisy = replace(begun, strength=np.full_like(begun.strength, 9.0))
    assert selection.evidence(selection.renewed(too_noisy)) > selection.evidence(too_noisy) + 100
    names = [form.name for form in selection.columns.forms]
    tried = iter([[0, next(k for k, name in enumerate(names) if name != names[0])], []])
    monkeypatch.setattr(Selection, "_worth_trying", lambda *_: next(tried))  # private: nothing is worth trying here
    posterior = selection.posterior(too_noisy)
    assert selection.forward_step(too_noisy, posterior, try_unknown=False) == (None, None)


def test_faults_whose_shapes_are_local_optima_are_fitted_again() -> None:
    """Two in a row, of which the first moves to the end when it is fitted again."""
    truths = [ReversalSpike(axis=axis, amplitude_deg=0.3, decay_s=0.18, slow=0.05, rise=0.03) for axis in (2, 3)]
    selection = Selection(holding(healthy(), white(healthy(), 12) + shown_by(healthy(), truths)), healthy_columns())
    begun = [ReversalSpike(axis=axis, amplitude_deg=0.45, decay_s=0.05, slow=0.8, rise=0.15) for axis in (2, 3)]
    state = selection.initial_state(begun)
    again = selection.fitted_again(state)
    assert set(_found(again)) == set(_found(state)) == {"reversal_spike 2", "reversal_spike 3"}
    assert selection.evidence(again) > selection.evidence(state) + 100
    for name, held in _found(state).items():
        assert getattr(held, "slow", 0.0) > 0.6  # its quick part and its slow one are exchanged
        assert getattr(_found(again)[name], "decay_s", 0.0) == pytest.approx(0.18, rel=0.02)
        assert getattr(_found(again)[name], "amplitude_deg", 0.0) == pytest.approx(0.3, rel=0.01)


def test_a_fault_that_was_fitted_again_before_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = JointOffset(axis=2, offset_deg=0.2), JointOffset(axis=3, offset_deg=0.2)
    selection = Selection(holding(healthy(), shown_by(healthy(), [first, second])), healthy_columns())
    state, tried = selection.initial_state((first, second)), list[str]()

    def recorded(_: Selection, of: SelectionState, place: int) -> SelectionState:
        tried.append(name_of(of.effects[place]))
        return of

    monkeypatch.setattr(Selection, "without", recorded)  # what is fitted again does not show in a state
    monkeypatch.setattr(Selection, "with_form", lambda _, of, posterior, k: of)
    assert selection.fitted_again(state, (first.model_copy(update={"offset_deg": 0.3}),)) is state
    assert tried == ["joint_offset 3"]


def test_waves_of_other_orders_are_not_one_however_near() -> None:
    wave = TransmissionError(axis=1, order=20, amplitude_deg=0.01)
    assert is_one(wave, wave.model_copy(update={"order": 20.3, "amplitude_deg": 0.05}))
    assert not is_one(wave, wave.model_copy(update={"order": 22.0}))
    assert is_one(JointOffset(axis=2, offset_deg=0.2), JointOffset(axis=2, offset_deg=0.1))
    assert not is_one(JointOffset(axis=2, offset_deg=0.2), JointOffset(axis=3, offset_deg=0.2))


def test_an_effect_is_twice_there_where_its_name_and_order_are() -> None:
    wave = TransmissionError(axis=1, order=30.0, amplitude_deg=0.01)
    near, far = (wave.model_copy(update={"order": order}) for order in (30.4, 31.0))
    other = TransmissionError(axis=2, order=30.0, amplitude_deg=0.01)
    assert (
        is_duplicate([wave, other, near]) and not is_duplicate([wave, other, far]) and not is_duplicate([wave, other])
    )
    assert not is_duplicate([wave]) and not is_duplicate([JointOffset(axis=1, offset_deg=0.1), wave])


def test_a_target_far_from_where_it_was_fitted_is_no_length() -> None:
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


def test_what_healthy_arms_show_is_fitted_in_its_shape() -> None:
    """Effects of about healthy size, of shapes beside any grid."""
    truths = [
        Backlash(axis=1, width_deg=0.014, transit=0.5),
        TransmissionError(axis=1, order=17.4, amplitude_deg=0.006, phase_deg=20.0),
    ]
    _, state = _searched(white(healthy(), 13) + shown_by(healthy(), truths))
    found = _found(state)
    assert set(found) == {"backlash 1", "transmission_error 1"}
    assert getattr(found["transmission_error 1"], "order", 0.0) == pytest.approx(17.4, rel=0.01)
    assert size_of(found["backlash 1"]) == pytest.approx(1.4, rel=0.1)


@pytest.mark.parametrize(("level", "is_fault"), [(0.3, True), (1.0, False), (3.0, False)])
def test_a_fault_is_more_than_healthy_arms_and_arms_like_this_one_show(level: float, is_fault: bool) -> None:
    selection = Selection(holding(healthy(), white(healthy(), 15)), healthy_columns())
    small, large = JointOffset(axis=2, offset_deg=0.04), JointOffset(axis=3, offset_deg=0.16)
    state = replace(selection.initial_state((small, large)), level=Level(level))
    refined = replace(state.refined, effects=(small, large))
    state = replace(state, refined=refined)
    assert (state.may_be_fault(0), state.may_be_fault(1)) == (is_fault, True)


def test_waves_of_other_orders_are_other_effects() -> None:
    wave = TransmissionError(axis=1, order=20.0, amplitude_deg=0.01)
    assert is_alike(wave, wave.model_copy(update={"order": 21.0}))
    assert not is_alike(wave, wave.model_copy(update={"order": 30.0}))
    assert not is_alike(wave, wave.model_copy(update={"axis": 2}))


def test_two_coefficients_of_a_wave_are_its_size_and_phase() -> None:
    wave = TransmissionError(axis=1, order=20.0)
    found = combined_effect((wave, wave), np.array([3.0, 4.0]))
    assert size_of(found) == pytest.approx(5.0)
    assert getattr(found, "phase_deg", 0.0) == pytest.approx(np.degrees(np.arctan2(4.0, 3.0)))


def test_a_rival_that_is_beside_the_name_already_explains_nothing_more_there(monkeypatch: pytest.MonkeyPatch) -> None:
    """A wave may move to another order once a name is left out; the form that it came from is a rival of the name then,
    and is no form of the background beside it."""
    wave, offset = TransmissionError(axis=1, order=20.0, amplitude_deg=0.003), JointOffset(axis=2, offset_deg=0.2)
    selection = Selection(holding(healthy(), white(healthy(), 17) + shown_by(healthy(), [wave])), healthy_columns())
    state = selection.initial_state((offset, wave))
    without, gains = Selection.without, Selection.gains

    def moving(selection: Selection, state: SelectionState, place: int) -> SelectionState:
        rest = without(selection, state, place)
        (left,) = rest.effects
        effects = (left.model_copy(update={"order": 40.0}),)
        refined = replace(rest.refined, effects=effects, residual=selection.linear.residual(effects))
        return replace(rest, refined=refined)

    def of_that_wave(selection: Selection, of: SelectionState, posterior: CoefficientPosterior) -> Array:
        own = [is_alike(form.effect, wave) for form in selection.columns.forms]
        return gains(selection, of, posterior) if of is state else np.where(own, 1e6, -np.inf)

    monkeypatch.setattr(Selection, "without", moving)
    monkeypatch.setattr(Selection, "gains", of_that_wave)
    monkeypatch.setattr("analysis.diagnosis.fit.rivals._DOUBT", np.inf)  # private: every fault that helps is tried
    one = rival_odds(selection, state, 0)
    assert [name_of(tried.effects[-1]) for tried, _ in one.rivals] == ["transmission_error 1"]
    assert one.odds + one.healthy_odds + one.rivals[0][1] == pytest.approx(1.0)


@pytest.mark.parametrize(("offset_deg", "level"), [(0.2, 1.0), (0.08, 0.5)])
def test_only_what_is_a_fault_in_a_quiet_arm_alone_has_no_rivals_below_the_limits(
    offset_deg: float, level: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is larger than any healthy arm shows is always said; the rest has only faults as rivals."""
    zero, linear, compared = JointOffset(axis=3, offset_deg=offset_deg), healthy(), list[str]()
    selection = Selection(holding(linear, shown_by(linear, [zero]) + white(linear, 18)), healthy_columns())
    state = replace(selection.initial_state((zero,)), level=Level(level))

    def odds(_: Selection, of: SelectionState, place: int, *, faults_only: bool) -> RivalOdds:
        compared.extend([] if faults_only else [name_of(of.effects[place])])
        return RivalOdds(1.0)

    monkeypatch.setattr("analysis.diagnosis.fit.rivals.cautious_odds", odds)
    for limit in (1.1, 0.9):  # of what the readings of the test change by that shows it most
        found, _ = compare_with_rivals(
            selection, state, limit * rms_by_block(linear, shown_by(linear, [zero])).um.max()
        )
        assert [name_of(effect) for effect in found.effects] == ["joint_offset 3"]
        assert compared == ["joint_offset 3"] * (limit < 1 or level == 1.0)
        compared.clear()


def test_every_name_is_compared_with_its_rivals_after_the_last_swap(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rivals that are always likelier: after the last swap each name is compared with its rivals again."""
    selection = Selection(holding(healthy(), white(healthy(), 16)), healthy_columns())
    first = selection.initial_state((JointOffset(axis=2, offset_deg=0.2), JointOffset(axis=3, offset_deg=0.2)))
    swaps: list[SelectionState] = []

    def likelier(_: Selection, state: SelectionState) -> SelectionState:
        swaps.append(replace(state, level=Level(state.level.others / 2)))
        return swaps[-1]

    # private: rivals that are likelier after every swap cannot be made of readings
    monkeypatch.setattr("analysis.diagnosis.fit.rivals.without_needless_names", lambda _, state, limits: state)
    monkeypatch.setattr(
        "analysis.diagnosis.fit.rivals.cautious_odds",
        lambda selection, state, place, **_: RivalOdds(0.1, ((state, 0.9),), state.level.others),
    )
    monkeypatch.setattr(SelectionState, "may_be_fault", lambda *_: True)
    monkeypatch.setattr(Selection, "select", likelier)
    monkeypatch.setattr(Selection, "evidence_of_names", lambda _, state: -state.level.others)
    last, rivalries = compare_with_rivals(selection, first, np.zeros(len(healthy().blocks)))
    assert last is swaps[-1] and len(swaps) > 1
    assert [one.healthy_odds for one in rivalries] == [last.level.others] * 2
