"""Readings that do not contain what a name adds to them contradict the name, at places used and at others."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from analysis.diagnosis.blocks import blocks_of
from analysis.diagnosis.candidates import candidates_for
from analysis.diagnosis.columns import Columns, columns_for
from analysis.diagnosis.contradiction import contradicted
from analysis.diagnosis.linearisation import Linearisation, linearise
from analysis.diagnosis.observed_run import observe_run
from analysis.diagnosis.run_setups import fit_run_setups
from analysis.diagnosis.search import SearchResult
from analysis.diagnosis.selection import Selection
from analysis.model.predict import model_of
from analysis.simulation.simulate import simulate
from rigs.effects import Effect, TransmissionError
from tests.support.diagnosis_cells import RIG, circles, holding, seen, shown_by, white

GEAR = TransmissionError(axis=1, order=3.0, amplitude_deg=0.2, phase_deg=40.0)
_CIRCLE = RIG.tests.circle.model_copy(update={"centre_mm": (870.0, 30.0, 250.0)}) if RIG.tests.circle else None
ELSEWHERE = RIG.model_copy(update={"tests": RIG.tests.model_copy(update={"circle": _CIRCLE})})


@cache
def _yaw_and_roll() -> Linearisation:
    runs = seen(circles(seed=92, tests=("yaw", "roll")))
    setups, _ = fit_run_setups(runs)
    return linearise(blocks_of(runs, setups), setups)


@cache
def _columns() -> Columns:
    return columns_for(_yaw_and_roll(), candidates_for(_yaw_and_roll()))


@cache
def _named(share_in_roll: float) -> SearchResult:
    """The gear named in readings of which roll contains a share of it."""
    linear = _yaw_and_roll()
    roll = np.concatenate([np.full(len(block.y_mm), block.one.setup == "roll") for block in linear.blocks])
    added = shown_by(linear, [GEAR]) * np.where(roll, share_in_roll, 1.0)
    selection = Selection(holding(linear, white(linear, 21) + added), _columns())
    state = selection.initial_state((GEAR,))
    return SearchResult(selection.linear, selection, state, selection.posterior(state), ())


@pytest.mark.parametrize(("share_in_roll", "wrong"), [(1.0, False), (0.9, False), (0.0, True)])
def test_a_set_up_contradicts_a_name_that_it_does_not_contain(share_in_roll: float, *, wrong: bool) -> None:
    assert contradicted(_named(share_in_roll), []) == [wrong]


@pytest.mark.parametrize(("there", "wrong"), [((GEAR,), False), ((), True)])
def test_a_run_at_an_unseen_place_contradicts_a_name_that_it_does_not_contain(
    there: tuple[Effect, ...], *, wrong: bool
) -> None:
    run = observe_run(model_of(ELSEWHERE), simulate(ELSEWHERE, "yaw", "cw", 5, there), "elsewhere")
    assert contradicted(_named(1.0), [run]) == [wrong]


def test_an_effect_of_healthy_size_is_not_judged() -> None:
    linear, small = _yaw_and_roll(), GEAR.model_copy(update={"amplitude_deg": 0.004})
    selection = Selection(holding(linear, white(linear, 22) + shown_by(linear, [small])), _columns())
    state = selection.initial_state((small,))
    assert contradicted(SearchResult(selection.linear, selection, state, selection.posterior(state), ()), []) == [False]
