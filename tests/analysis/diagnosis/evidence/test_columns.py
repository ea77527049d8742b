"""What a healthy arm is expected to have of every effect, and the level that it shows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.fit.candidates import HEALTHY, Candidate, Level, columns_for, order_of
from analysis.diagnosis.fit.responses import linearise
from analysis.diagnosis.fit.selection import Selection
from analysis.diagnosis.fit.selection_state import Backgrounds, Hyperparameters
from rigs.effects import Backlash, ServoLag, TransmissionError
from tests.support.diagnosis_cells import Array, healthy, healthy_columns, holding, shown_by, white

MEAN = np.sqrt(2 / np.pi)
"""Of the magnitude of a normal variable of standard deviation 1."""


def _of(name: str, values: Array) -> Array:
    own: Array = values[[k for form in healthy_columns().forms if form.name == name for k in form.columns]]
    return own


@pytest.mark.parametrize("name", ["backlash 1", "compliance 2", "servo_lag 3"])
def test_a_size_that_cannot_be_negative_has_the_moments_of_a_magnitude(name: str) -> None:
    columns = healthy_columns()
    assert _of(name, columns.mean(Level(2.0))).sum() == pytest.approx(2 * MEAN)
    assert _of(name, columns.variance(Level(2.0))).sum() == pytest.approx(4 * (1 - MEAN**2))


@pytest.mark.parametrize("name", ["joint_offset 2", "transmission_error 1", "time_lag"])
def test_any_other_size_is_about_zero(name: str) -> None:
    columns = healthy_columns()
    assert not _of(name, columns.mean(Level(2.0))).any()
    assert _of(name, columns.variance(Level(2.0))).sum() == pytest.approx(4.0)


@pytest.mark.parametrize("axis", [1, 4])
def test_every_octave_of_a_gears_orders_is_equally_likely(axis: int) -> None:
    """A joint that turns far has a form for every order, and one that turns little has a few."""
    columns = healthy_columns()
    forms = [form for form in columns.forms if form.name == f"transmission_error {axis}"]
    orders = np.array([order_of(form.effects[0]) for form in forms])
    share = np.array([columns.variance(HEALTHY)[list(form.columns)].sum() for form in forms])
    octaves = np.array([share[(orders > low) & (orders <= 2 * low)].sum() for low in (4, 16, 50)])
    assert octaves == pytest.approx(np.full(3, octaves.mean()), rel=0.25)
    assert share.sum() == pytest.approx(1.0)


@pytest.mark.parametrize(("axis", "kept"), [(1, 5 / 6), (4, 0.0)])
def test_a_wave_of_another_order_may_be_beside_a_named_one(axis: int, kept: float) -> None:
    """The nearest form of a joint that turns little stands for six orders, of which the named wave takes one."""
    selection = Selection(healthy(), healthy_columns())
    backgrounds, state = Backgrounds(healthy_columns(), "industrial"), replace(selection.initial_state(), level=HEALTHY)
    name = f"transmission_error {axis}"
    orders = np.array([order_of(form.effects[0]) for form in healthy_columns().forms if form.name == name])
    before = _of(name, backgrounds.of(state).variance).reshape(-1, 2)
    for order in (36.0, 36.4):
        wave = TransmissionError(axis=axis, order=order, amplitude_deg=0.1)
        named = replace(state, refined=replace(state.refined, effects=(wave,)))
        left = _of(name, backgrounds.of(named).variance).reshape(-1, 2) / before
        np.testing.assert_allclose(left[orders == 36.0], kept, atol=0.01)
        np.testing.assert_allclose(left[orders != 36.0], 1.0)


@pytest.mark.parametrize("axis", [1, 2, 3])
def test_the_mean_of_a_play_is_a_play_of_healthy_width(axis: int) -> None:
    """Its forms are of 0.01 to 30 healthy widths and in three shapes, and do not resemble one another."""
    linear, columns = healthy(), healthy_columns()
    play = shown_by(linear, [Backlash(axis=axis, width_deg=0.01 * MEAN)])
    own = [k for form in columns.forms if form.name == f"backlash {axis}" for k in form.columns]
    left = linear.without_set_up(play - columns.X[:, own] @ columns.mean(HEALTHY)[own])
    assert np.linalg.norm(left) < 0.15 * np.linalg.norm(linear.without_set_up(play))


def test_what_the_model_contains_already_may_lack_either_sign() -> None:
    lag = ServoLag(axis=2, lag_s=0.01)
    linear = healthy()
    blocks = tuple(replace(one, model=replace(one.model, effects=(lag,))) for one in linear.blocks)
    candidates = [Candidate(f"servo_lag {axis}", (ServoLag(axis=axis, lag_s=5e-4),)) for axis in (2, 3)]
    columns = columns_for(linearise(blocks, linear.setups), candidates)
    assert columns.mean(HEALTHY)[:2] == pytest.approx([0.0, MEAN])
    assert columns.variance(HEALTHY)[:2] == pytest.approx([1.0, 1 - MEAN**2])


def test_a_named_effect_is_not_expected_beside_itself() -> None:
    selection = Selection(healthy(), healthy_columns())
    backgrounds, state = Backgrounds(healthy_columns(), "industrial"), replace(selection.initial_state(), level=HEALTHY)
    named = replace(state, refined=replace(state.refined, effects=(ServoLag(axis=3, lag_s=0.01),)))
    assert _of("servo_lag 3", backgrounds.of(state).mean).sum() == pytest.approx(MEAN)
    assert not _of("servo_lag 3", backgrounds.of(named).mean).any()
    assert _of("servo_lag 2", backgrounds.of(named).mean).sum() == pytest.approx(MEAN)


@pytest.mark.parametrize("level", [0.03, 0.3, 1.0])
def test_the_level_of_an_arm_is_found_from_what_it_shows(level: float) -> None:
    """Each name is in one of its forms, and the estimate begins at the level of a healthy arm."""
    columns, rng = healthy_columns(), np.random.default_rng(3)
    size = np.zeros(columns.X.shape[1])
    for name in columns.among:
        first = min((form for form in columns.forms if form.name == name), key=lambda form: abs(np.log(form.size)))
        drawn = rng.normal(size=len(first.columns)) / np.sqrt(len(first.columns))
        size[list(first.columns)] = level * (np.abs(drawn) if first.one_sided else drawn)
    selection = Selection(holding(healthy(), columns.X @ size + white(healthy(), 4)), columns)
    state, hyperparameters = (
        replace(selection.initial_state(), level=HEALTHY),
        Hyperparameters(selection.linear, columns),
    )
    for _ in range(12):
        state = replace(state, level=hyperparameters.level(state, selection.posterior(state)))
    assert 0.6 < state.level.others / level < 1.6


def test_an_arm_with_quiet_gears_may_have_inaccurate_links_and_soft_joints() -> None:
    """The small errors are lengths, zeros and deflections under load alone, at half of their healthy sizes."""
    columns, rng = healthy_columns(), np.random.default_rng(5)
    apart = [k for form in columns.forms if form.effect.part in ("constants", "gravity") for k in form.columns]
    size = np.zeros(columns.X.shape[1])
    size[apart] = 0.5 * np.abs(rng.normal(size=len(apart)))
    selection = Selection(holding(healthy(), columns.X @ size + white(healthy(), 6)), columns)
    level = selection.initial_state().level
    assert level.others < 0.1 and level.by_part()["constants"] > 0.2
