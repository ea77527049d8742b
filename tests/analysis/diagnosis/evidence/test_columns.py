from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.fit.candidates import HEALTHY, Level, order_of
from analysis.diagnosis.fit.selection import Selection
from analysis.diagnosis.fit.selection_state import Backgrounds
from rigs.effects import ServoLag
from tests.support.diagnosis_cells import Array, healthy, healthy_columns, holding, white

MEAN = np.sqrt(2 / np.pi)
"""Of the magnitude of a normal variable of standard deviation 1."""


def _of(name: str, values: Array) -> Array:
    own: Array = values[[k for form in healthy_columns().forms if form.name == name for k in form.columns]]
    return own


@pytest.mark.parametrize("name", ["backlash 1", "compliance 2", "servo_lag 3"])
def test_a_size_that_cannot_be_negative_has_the_moments_of_a_magnitude(name):
    columns = healthy_columns()
    assert _of(name, columns.mean(Level(2.0))).sum() == pytest.approx(2 * MEAN)
    assert _of(name, columns.variance(Level(2.0))).sum() == pytest.approx(4 * (1 - MEAN**2))


@pytest.mark.parametrize("name", ["joint_offset 2", "transmission_error 1", "time_lag"])
def test_any_other_size_is_about_zero(name):
    columns = healthy_columns()
    assert not _of(name, columns.mean(Level(2.0))).any()
    assert _of(name, columns.variance(Level(2.0))).sum() == pytest.approx(4.0)


@pytest.mark.parametrize("axis", [1, 4])
def test_every_octave_of_a_gears_orders_is_equally_likely(axis):
    columns = healthy_columns()
    forms = [form for form in columns.forms if form.name == f"transmission_error {axis}"]
    orders = np.array([order_of(form.effects[0]) for form in forms])
    share = np.array([columns.variance(HEALTHY)[list(form.columns)].sum() for form in forms])
    octaves = np.array([share[(orders > low) & (orders <= 2 * low)].sum() for low in (4, 16, 50)])
    assert octaves == pytest.approx(np.full(3, octaves.mean()), rel=0.25)
    assert share.sum() == pytest.approx(1.0)


def test_a_named_effect_is_not_expected_beside_itself():
    selection = Selection(healthy(), healthy_columns())
    backgrounds, state = Backgrounds(healthy_columns(), "industrial"), replace(selection.initial_state(), level=HEALTHY)
    named = replace(state, refined=replace(state.refined, effects=(ServoLag(axis=3, lag_s=0.01),)))
    assert _of("servo_lag 3", backgrounds.of(state).mean).sum() == pytest.approx(MEAN)
    assert not _of("servo_lag 3", backgrounds.of(named).mean).any()
    assert _of("servo_lag 2", backgrounds.of(named).mean).sum() == pytest.approx(MEAN)


@pytest.mark.parametrize("level", [0.03, 0.3, 1.0])
def test_level_of_an_arm_is_found_from_its_readings(level):
    columns, rng = healthy_columns(), np.random.default_rng(3)
    size = np.zeros(columns.X.shape[1])
    for name in columns.among:
        first = min((form for form in columns.forms if form.name == name), key=lambda form: abs(np.log(form.size)))
        drawn = rng.normal(size=len(first.columns)) / np.sqrt(len(first.columns))
        size[list(first.columns)] = level * (np.abs(drawn) if first.one_sided else drawn)
    selection = Selection(holding(healthy(), columns.X @ size + white(healthy(), 4)), columns)
    state = replace(selection.initial_state(), level=HEALTHY)
    for _ in range(12):
        state = replace(state, level=selection.level(state, selection.posterior(state)))
    assert 0.6 < state.level.others / level < 1.6
