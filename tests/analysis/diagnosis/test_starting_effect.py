"""Where the fit of an effect starts: near enough to its width or order that it ends there."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from analysis.diagnosis.candidates import candidates_for
from analysis.diagnosis.columns import Columns, columns_for
from analysis.diagnosis.selection import Selection
from analysis.diagnosis.selection_state import SelectionState
from analysis.diagnosis.starting_effect import starting_effects
from rigs.effects import Backlash, Effect, JointOffset
from tests.support.diagnosis_cells import Array, healthy, holding, shown_by, white


@cache
def _columns() -> Columns:
    return columns_for(healthy(), candidates_for(healthy()))


def _begun(*truth: Effect) -> tuple[Selection, SelectionState, Array]:
    """A search before anything is named: what the faults do counts as noise as yet."""
    y = white(healthy(), 21) + shown_by(healthy(), list(truth))
    selection = Selection(holding(healthy(), y), _columns())
    return selection, selection.initial_state(), y


def _width(effect: Effect) -> float:
    return float(getattr(effect, "width_deg", np.nan))


@pytest.mark.parametrize(("width_deg", "transit"), [(0.03, 0.5), (0.3, 0.05), (0.95, 0.05)])
def test_the_fit_of_a_play_starts_near_its_width(width_deg: float, transit: float) -> None:
    selection, state, _ = _begun(Backlash(axis=1, width_deg=width_deg, transit=transit))
    posterior = selection.posterior(state)
    for form in _columns().forms:
        if form.name == "backlash 1":
            widths = [_width(effect) for effect in starting_effects(selection.linear, _columns(), posterior, form)]
            assert min(abs(np.log(width / width_deg)) for width in widths) < 0.25


def test_an_effect_of_one_shape_starts_at_the_size_that_it_would_have() -> None:
    selection, state, _ = _begun(JointOffset(axis=3, offset_deg=0.2))
    k = next(k for k, form in enumerate(_columns().forms) if form.name == "joint_offset 3")
    (effect,) = starting_effects(selection.linear, _columns(), selection.posterior(state), _columns().forms[k])
    assert getattr(effect, "offset_deg", 0.0) == pytest.approx(0.2, rel=0.2)


def test_a_play_of_95_healthy_sizes_is_found_as_it_is_and_alone() -> None:
    """From the noise before it was found, its fit had ended beside it, and the rest had drawn other names."""
    selection, state, y = _begun(Backlash(axis=1, width_deg=0.95, transit=0.05))
    found = selection.select(state)
    (effect,) = [one for k, one in enumerate(found.refined.effects) if found.is_fault(k)]
    assert _width(effect) == pytest.approx(0.95, rel=0.01)
    assert np.mean(selection.posterior(found).residual ** 2) < 2 < np.mean(y**2)
