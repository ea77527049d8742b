"""What a search computes its columns beside, and how often."""

from __future__ import annotations

import numpy as np

from analysis.diagnosis.blocks import blocks_of
from analysis.diagnosis.linearisation import Linearisation, linearise
from analysis.diagnosis.search import search
from rigs.effects import Effect, LinkGeometry, TransmissionError
from rigs.schema.effect import name_of
from tests.support.diagnosis_cells import Array, circles, seen

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


def _missed(linear: Linearisation, effect: Effect, faults: tuple[Effect, ...]) -> float:
    """How far the column of an effect is from what it adds beside faults, in standard deviations."""
    exact: Array = linear.residual(faults) - linear.residual((*faults, effect))
    return float(np.linalg.norm(linear.without_set_up(exact - linear.columns([effect])[:, 0])))
