"""Columns of a search: the faults at which they are computed, and the conditions for a new computation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analysis.diagnosis.evidence.blocks import blocks_of
from analysis.diagnosis.evidence.setups import fit_run_setups, with_effects
from analysis.diagnosis.fit.candidates import Level, candidates_for, columns_for
from analysis.diagnosis.fit.responses import Linearisation, linearise
from analysis.diagnosis.fit.search import search
from analysis.diagnosis.fit.selection import Selection
from analysis.diagnosis.fit.selection_state import SelectionState
from rigs.effects import Backlash, Effect, LinkGeometry, ServoLag, TransmissionError
from rigs.schema.effect import name_of, scaled
from tests.support.diagnosis_cells import Array, circles, healthy, healthy_columns, seen, shown_by

SELECTING = "selecting effects"


def test_an_arm_without_faults_needs_one_search() -> None:
    said: list[str] = []
    result = search(seen(circles(seed=93)), said.append)
    assert result.effects == () and said.count(SELECTING) == 1


def test_columns_contain_what_the_faults_change() -> None:
    """A length changes the lever of a gear error, and with it the readings of the gear error."""
    runs = seen(circles((TransmissionError(axis=4, order=30, amplitude_deg=0.3, phase_deg=60),), seed=94))
    said: list[str] = []
    result = search(runs, said.append)
    effects = result.effects
    assert {name_of(effect) for effect in effects} == {"transmission_error 4"} and said.count(SELECTING) == 2
    without = linearise(blocks_of(runs, result.linear.setups), result.linear.setups)
    longer = LinkGeometry(axis=5, field="a", delta=0.2)
    assert _missed(result.linear, longer, effects) < 0.1 * _missed(without, longer, effects)


GEAR = TransmissionError(axis=4, order=116, amplitude_deg=0.3, phase_deg=60)
LAG = ServoLag(axis=1, lag_s=0.02)


def _beside(*known: Effect, moved_mm: float = 0.0) -> Selection:
    """The selection of effects on healthy circles, with columns beside known ones and a ball that is elsewhere."""
    setups = {name: replace(one, ball=one.ball + np.array([moved_mm, 0, 0])) for name, one in healthy().setups.items()}
    runs = seen(circles(seed=90))
    return Selection(linearise(blocks_of(runs, setups, known), setups, known), healthy_columns())


def _with(*effects: Effect, level: float = 1.0) -> SelectionState:
    empty = Selection(healthy(), healthy_columns()).initial_state()
    return replace(empty, level=Level(level), refined=replace(empty.refined, effects=effects))


def test_columns_hold_for_faults_that_hardly_changed() -> None:
    """The healthy effects beside them do not count, and neither does their order in the list."""
    state = _with(GEAR, ServoLag(axis=2, lag_s=0.0005), LAG)
    assert _beside(LAG, GEAR).is_valid_for(state) and _beside(LAG, scaled(GEAR, 1.05)).is_valid_for(state)
    assert not _beside(LAG, scaled(GEAR, 1.2)).is_valid_for(state)
    assert not _beside(GEAR.model_copy(update={"order": 20.0}), LAG).is_valid_for(state)
    assert not _beside(GEAR).is_valid_for(state) and not _beside().is_valid_for(state)
    assert not _beside(GEAR, LAG, ServoLag(axis=3, lag_s=0.02)).is_valid_for(state)
    assert not _beside(GEAR, LAG, moved_mm=1.0).is_valid_for(state)  # set-ups that move by a millimetre
    assert _beside().is_valid_for(_with()) and not _beside(GEAR).is_valid_for(_with())


def test_columns_hold_for_faults_that_hardly_show() -> None:
    sigma = float(np.linalg.norm(healthy().without_set_up(shown_by(healthy(), [GEAR]))))
    for shown, holds in ((50.0, True), (200.0, False)):
        assert _beside().is_valid_for(_with(scaled(GEAR, shown / sigma), level=1e-4)) is holds


def _selection(effects: tuple[Effect, ...], *known: Effect) -> Selection:
    """The selection of effects on circles of an arm with some effects, with columns beside known ones."""
    runs = seen(circles(effects, seed=95))
    setups, _ = fit_run_setups(with_effects(runs, known))
    linear = linearise(blocks_of(runs, setups, known), setups, known)
    return Selection(linear, columns_for(linear, candidates_for(linear)))


def _orders(state: SelectionState) -> list[tuple[str, int]]:
    return sorted((name_of(effect), round(getattr(effect, "order", 0))) for effect in state.effects)


def test_a_selection_stops_at_a_new_fault_beside_which_its_columns_do_not_hold() -> None:
    """At a second wave of the same gear too; not at one beside which they were computed."""
    faults = (GEAR, GEAR.model_copy(update={"order": 30.0, "amplitude_deg": 0.2}))
    selection = _selection(faults)
    begun = selection.initial_state()
    first = selection.select(begun, stops=True)
    assert len(first.effects) == 1 and not selection.is_valid_for(first)
    second = _selection(faults, *first.effects)
    both = second.select(second.initial_state(first.effects), stops=True)
    assert _orders(both) == [("transmission_error 4", 30), ("transmission_error 4", 116)]
    assert not second.is_valid_for(both)
    last = _selection(faults, *both.effects)
    complete = last.select(last.initial_state(both.effects), stops=True)
    assert set(_orders(complete)) >= set(_orders(both)) and last.is_valid_for(complete)


def test_a_selection_does_not_stop_at_effects_of_healthy_size() -> None:
    small = (
        Backlash(axis=1, width_deg=0.014, transit=0.5),
        TransmissionError(axis=1, order=17.4, amplitude_deg=0.006, phase_deg=20.0),
    )
    selection = _selection(small)
    state = selection.select(selection.initial_state(), stops=True)
    assert {name_of(effect) for effect in state.effects} >= {name_of(effect) for effect in small}


def _missed(linear: Linearisation, effect: Effect, faults: tuple[Effect, ...]) -> float:
    """Return the error of an effect's column next to faults, in standard deviations."""
    exact: Array = linear.residual(faults) - linear.residual((*faults, effect))
    return float(np.linalg.norm(linear.without_set_up(exact - linear.columns([effect])[:, 0])))
