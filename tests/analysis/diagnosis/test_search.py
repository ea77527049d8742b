"""What a search computes its columns beside, and how often."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analysis.diagnosis.blocks import blocks_of
from analysis.diagnosis.linearisation import Linearisation, linearise
from analysis.diagnosis.search import is_about, search
from analysis.diagnosis.selection import Selection
from rigs.effects import Effect, JointOffset, LinkGeometry, TransmissionError
from rigs.schema.effect import name_of
from tests.support.diagnosis_cells import Array, circles, healthy, healthy_columns, seen

SELECTING = "selecting effects"


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


def test_columns_hold_for_faults_that_hardly_changed() -> None:
    """The healthy effects beside them do not count, and neither does their order in the list."""
    gear = TransmissionError(axis=4, order=116, amplitude_deg=0.3, phase_deg=60)
    length, small = LinkGeometry(axis=2, field="a", delta=2.0), LinkGeometry(axis=3, field="a", delta=0.3)
    selection = Selection(healthy(), healthy_columns())
    state = selection.initial_state()
    state = replace(state, level=1.0, refined=replace(state.refined, effects=(gear, small, length)))
    moves = np.zeros(healthy().U.shape[1])

    def holds(*known: Effect) -> bool:
        return is_about(healthy(), known, state, moves)

    assert holds(length, gear.model_copy(update={"amplitude_deg": 0.301}))
    assert not holds(gear.model_copy(update={"order": 20.0}), length)
    assert not holds(gear) and not holds() and not holds(gear, length, JointOffset(axis=5, offset_deg=1.0))
    assert not is_about(healthy(), (gear, length), state, moves + 1.0), "set-ups that move by a millimetre"


def _missed(linear: Linearisation, effect: Effect, faults: tuple[Effect, ...]) -> float:
    """How far the column of an effect is from what it adds beside faults, in standard deviations."""
    exact: Array = linear.residual(faults) - linear.residual((*faults, effect))
    return float(np.linalg.norm(linear.without_set_up(exact - linear.columns([effect])[:, 0])))
