"""What a search computes its columns beside, and how often."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analysis.diagnosis.blocks import blocks_of
from analysis.diagnosis.linearisation import Linearisation, linearise
from analysis.diagnosis.search import search
from analysis.diagnosis.selection import Selection
from analysis.diagnosis.selection_state import SelectionState
from rigs.effects import Backlash, Effect, JointOffset, LinkGeometry, ServoLag, TransmissionError
from rigs.schema.effect import name_of
from tests.support.diagnosis_cells import Array, circles, healthy, healthy_columns, holding, seen, shown_by, white

SELECTING = "selecting effects"
SMALL = (
    Backlash(axis=1, width_deg=0.014, transit=0.5),
    TransmissionError(axis=1, order=17.4, amplitude_deg=0.006, phase_deg=20.0),
)
"""Effects of about healthy size."""


def test_an_arm_without_faults_needs_one_search() -> None:
    said: list[str] = []
    result = search(seen(circles(seed=93)), said.append)
    assert result.state.refined.effects == () and said.count(SELECTING) == 1


def test_columns_contain_what_the_faults_change() -> None:
    """A length changes the lever of a gear error, and with it the readings of the gear error."""
    runs = seen(circles((TransmissionError(axis=4, order=30, amplitude_deg=0.3, phase_deg=60),), seed=94))
    said: list[str] = []
    result = search(runs, said.append)
    effects = result.state.refined.effects
    assert {name_of(effect) for effect in effects} == {"transmission_error 4"} and said.count(SELECTING) == 2
    without = linearise(blocks_of(runs, result.linear.setups), result.linear.setups)
    longer = LinkGeometry(axis=5, field="a", delta=0.2)
    assert _missed(result.linear, longer, effects) < 0.1 * _missed(without, longer, effects)


def _beside(*known: Effect, moved_mm: float = 0.0) -> Selection:
    """The selection of effects on healthy circles, with columns beside known ones and a ball that is elsewhere."""
    runs = seen(circles(seed=90))
    setups = {name: replace(one, ball=one.ball + np.array([moved_mm, 0, 0])) for name, one in healthy().setups.items()}
    return Selection(linearise(blocks_of(runs, setups, known), setups, known), healthy_columns())


def test_columns_hold_for_faults_that_hardly_changed() -> None:
    """The healthy effects beside them do not count, and neither does their order in the list."""
    gear = TransmissionError(axis=4, order=116, amplitude_deg=0.3, phase_deg=60)
    lag, small = ServoLag(axis=1, lag_s=0.02), ServoLag(axis=2, lag_s=0.0005)
    empty = Selection(healthy(), healthy_columns()).initial_state()
    state = replace(empty, level=1.0, refined=replace(empty.refined, effects=(gear, small, lag)))
    assert _beside(lag, gear.model_copy(update={"amplitude_deg": 0.301})).holds_for(state)
    assert not _beside(gear.model_copy(update={"order": 20.0}), lag).holds_for(state)
    assert not _beside(gear).holds_for(state) and not _beside().holds_for(state)
    assert not _beside(gear, lag, ServoLag(axis=3, lag_s=0.02)).holds_for(state)
    assert not _beside(gear, lag, moved_mm=1.0).holds_for(state), "set-ups that move by a millimetre"
    healthy_arm = replace(empty, level=1.0)
    assert _beside().holds_for(healthy_arm) and not _beside(gear).holds_for(healthy_arm)


def test_a_selection_stops_at_a_fault_beside_which_its_columns_do_not_hold() -> None:
    """It goes on where it may not stop, where the columns are beside the fault, and beside healthy effects."""
    faults = (Backlash(axis=1, width_deg=0.2, transit=0.35), JointOffset(axis=3, offset_deg=0.4))
    selection = Selection(holding(healthy(), shown_by(healthy(), faults) + white(healthy(), 1)), healthy_columns())
    begun = selection.initial_state()
    stopped, complete = selection.select(begun, stops=True), selection.select(begun)
    assert _names(stopped) < _names(complete) == {"backlash 1", "joint_offset 3"}
    assert not selection.holds_for(stopped) and len(stopped.refined.effects) == 1
    beside = Selection(linearise(selection.linear.blocks, selection.linear.setups, faults), healthy_columns())
    small = Selection(holding(healthy(), shown_by(healthy(), SMALL) + white(healthy(), 1)), healthy_columns())
    assert beside.holds_for(complete)
    assert _names(small.select(small.initial_state(), stops=True)) == {name_of(effect) for effect in SMALL}


def _names(state: SelectionState) -> set[str]:
    return {name_of(effect) for effect in state.refined.effects}


def _missed(linear: Linearisation, effect: Effect, faults: tuple[Effect, ...]) -> float:
    """How far the column of an effect is from what it adds beside faults, in standard deviations."""
    exact: Array = linear.residual(faults) - linear.residual((*faults, effect))
    return float(np.linalg.norm(linear.without_set_up(exact - linear.columns([effect])[:, 0])))
