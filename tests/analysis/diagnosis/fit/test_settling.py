from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.fit.candidates import Level
from analysis.diagnosis.fit.selection import Effort, Selection
from analysis.diagnosis.fit.selection_state import SelectionState, beginnings
from tests.support.diagnosis_cells import healthy, healthy_columns


def _begun(strength: float) -> SelectionState:
    state = Selection(healthy(), healthy_columns()).initial_state()
    return replace(state, strength=np.full_like(state.strength, strength))


def _fits(state: SelectionState, gain: Callable[[int], float], least: float = -np.inf) -> tuple[int, float]:
    """Number of fits, each with the given gain, until a state settles, and the log evidence of the result."""
    fits: list[SelectionState] = []

    class Gaining(Selection):
        def refitted(self, state: SelectionState, rounds: int = 0, *, only_large: bool = False) -> SelectionState:
            fits.append(replace(state, level=Level(state.level.others + gain(len(fits)))))
            return fits[-1]

        def renewed(self, state: SelectionState) -> SelectionState:
            return state

        def evidence(self, state: SelectionState) -> float:
            return state.level.others

    begins = beginnings(replace(state, level=Level(0.0)))
    best = Gaining(healthy(), healthy_columns()).settled(*begins, least=least)
    return len(fits), best.level.others


def test_a_state_is_fitted_until_it_gains_little():
    assert _fits(_begun(1.0), lambda k: 100.0 if k < 3 else 1.0) == (4, 301.0)


def test_a_state_whose_residual_is_above_the_noise_is_fitted_from_the_noise_too():
    count, best = _fits(_begun(9.0), lambda k: 100.0 if k in (0, 3, 4) else 1.0)
    assert (count, best) == (6, 202.0)


@pytest.mark.parametrize(("least", "fits"), [(200.0, 7), (800.0, 3), (650.0, 7)])
def test_state_that_cannot_reach_the_required_evidence_is_abandoned(least, fits):
    """A first fit of 100 and six more, of 99, 98, and so on, reach 679."""
    assert _fits(_begun(1.0), lambda k: 100.0 - k, least)[0] == fits


def test_a_state_whose_gains_rise_is_not_given_up():
    assert _fits(_begun(1.0), lambda k: 10.0 + k, 800.0)[0] == 7


VAIN = {"gain": 10.0, "before": 0.08, "after": 0.079}


def _rounds_until_spent(**changed: float) -> int:
    effort = Effort()
    while not effort.is_spent:
        effort.note(**{**VAIN, **changed})
    return effort.rounds


def test_a_search_ends_after_vain_rounds_beyond_those_of_a_sound_cell():
    assert _rounds_until_spent() == 10


@pytest.mark.parametrize("changed", [{"gain": 60.0}, {"after": 0.07}, {"before": 0.01, "after": 0.01}])
def test_a_round_that_gains_or_explains_or_has_nothing_to_explain_is_not_vain(changed):
    assert _rounds_until_spent(**changed) == 60


def test_only_successive_vain_rounds_count():
    effort = Effort()
    for gain in (*[10.0] * 8, 60.0, 10.0, 10.0, 10.0):
        effort.note(gain, 0.08, 0.08)
    assert not effort.is_spent and effort.vain == 3 and effort.rounds == 12
    effort.note(10.0, 0.08, 0.08)
    assert effort.is_spent
