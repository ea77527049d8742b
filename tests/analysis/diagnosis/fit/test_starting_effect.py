"""Where the fit of an effect starts: near enough to its width or order that it ends there."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.diagnosis.fit.selection import Selection
from analysis.diagnosis.fit.selection_state import SelectionState
from analysis.diagnosis.fit.starting_effects import starting_effects
from rigs.effects import Backlash, Effect, JointOffset, TransmissionError
from tests.support.diagnosis_cells import Array, healthy, healthy_columns, holding, shown_by, white


def _begun(*truth: Effect) -> tuple[Selection, SelectionState, Array]:
    """A search before anything is named: what the faults do counts as noise as yet."""
    y = white(healthy(), 21) + shown_by(healthy(), list(truth))
    selection = Selection(holding(healthy(), y), healthy_columns())
    return selection, selection.initial_state(), y


def _order(effect: Effect) -> float:
    return float(getattr(effect, "order", np.nan))


def _width(effect: Effect) -> float:
    return float(getattr(effect, "width_deg", np.nan))


@pytest.mark.parametrize(
    ("width_deg", "transit", "within"), [(0.001, 0.5, 0.5), (0.03, 0.5, 0.25), (0.3, 0.05, 0.25), (0.95, 0.05, 0.25)]
)
def test_the_fit_of_a_play_starts_near_its_width(width_deg: float, transit: float, within: float) -> None:
    """Also near one of a tenth of a healthy size, which a quiet cell shows, and other names would explain instead."""
    selection, state, _ = _begun(Backlash(axis=1, width_deg=width_deg, transit=transit))
    forms = [form for form in healthy_columns().forms if form.name == "backlash 1"]
    assert forms
    for form in forms:
        effects = starting_effects(selection.linear, healthy_columns(), selection.posterior(state), form)
        assert min(abs(np.log(_width(effect) / width_deg)) for effect in effects) < within


def test_an_effect_of_one_shape_starts_at_the_size_that_it_would_have() -> None:
    selection, state, _ = _begun(JointOffset(axis=3, offset_deg=0.2))
    k = next(k for k, form in enumerate(healthy_columns().forms) if form.name == "joint_offset 3")
    (effect,) = starting_effects(
        selection.linear, healthy_columns(), selection.posterior(state), healthy_columns().forms[k]
    )
    assert getattr(effect, "offset_deg", 0.0) == pytest.approx(0.2, rel=0.2)


def test_a_large_wave_starts_at_its_order_also_from_the_form_of_another_that_looks_like_it() -> None:
    """Axis 3 turns by less than a quarter and is mostly near the ends of its range: in a cell of the trial order 116
    gained more than the orders beside 121, and its fit ended there."""
    selection, state, _ = _begun(TransmissionError(axis=3, order=121, amplitude_deg=0.25, phase_deg=86))
    waves = [form for form in healthy_columns().forms if form.name == "transmission_error 3"]
    other = min(waves, key=lambda form: abs(_order(form.effects[0]) - 116))
    assert abs(_order(other.effects[0]) - 121) > 2.5
    effects = starting_effects(selection.linear, healthy_columns(), selection.posterior(state), other)
    assert min(abs(_order(effect) - 121) for effect in effects) < 1


def test_a_wave_of_healthy_size_starts_beside_its_form() -> None:
    selection, state, _ = _begun(TransmissionError(axis=3, order=121, amplitude_deg=0.005))
    for form in healthy_columns().forms:
        if form.name == "transmission_error 3":
            effects = starting_effects(selection.linear, healthy_columns(), selection.posterior(state), form)
            assert len(effects) == 1
            assert _order(effects[0]) == pytest.approx(_order(form.effects[0]), abs=2.5)


def test_a_play_of_95_healthy_sizes_is_found_as_it_is_and_alone() -> None:
    """From the noise before it was found, its fit had ended beside it, and the rest had drawn other names."""
    selection, state, y = _begun(Backlash(axis=1, width_deg=0.95, transit=0.05))
    found = selection.select(state)
    (effect,) = [one for k, one in enumerate(found.effects) if found.may_be_fault(k)]
    assert _width(effect) == pytest.approx(0.95, rel=0.01)
    assert np.mean(selection.posterior(found).residual ** 2) < 2 < np.mean(y**2)
