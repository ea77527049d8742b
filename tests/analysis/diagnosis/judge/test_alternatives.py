from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.evidence.blocks import Block
from analysis.diagnosis.fit.rivals import RivalOdds
from analysis.diagnosis.fit.search import SearchResult
from analysis.diagnosis.fit.selection import Selection
from analysis.diagnosis.fit.unknown import UnknownCauses, likeliest_kind, total_gain
from analysis.diagnosis.judge.alternatives import Hypotheses, hypotheses_of
from analysis.diagnosis.judge.probability import CONFIRMED, probabilities_of, probability_of
from rigs.effects import Backlash, Effect, LinkGeometry, TransmissionError
from tests.support.diagnosis_cells import Array, healthy, healthy_columns, holding, shown_by, white

ALTERNATIVES = Hypotheses({"nothing": -30.0, "healthy": -40.0, "rival": -1.0, "unknown": -4.0, "several": -20.0})


def test_probabilities_of_name_and_alternatives_sum_to_one():
    found = probabilities_of(ALTERNATIVES)
    assert found.name + sum(found.alternatives.values()) == pytest.approx(1.0)
    assert found.strongest == "rival" and min(found.alternatives.values()) >= 0
    assert found.with_rivals == pytest.approx(probability_of(ALTERNATIVES.log_odds(with_rivals=True)))


def _result(added: Array, *effects: Effect) -> SearchResult:
    linear = holding(healthy(), white(healthy(), 5) + added)
    selection = Selection(linear, healthy_columns())
    state = selection.initial_state(effects)
    return SearchResult(selection, state, tuple(RivalOdds(1.0) for _ in effects))


def _wandering(axis: int) -> Array:
    """An error of a joint over its angle that is no sum of few waves, of 300 sigma."""

    def off(block: Block) -> Array:
        x = block.path.q[:, axis - 1]
        return np.radians(0.01 * np.sin(40 * x**2 + axis))[:, None]

    added = healthy().without_set_up(healthy().by_joint(axis, off))[:, 0]
    return np.asarray(300 * added / np.linalg.norm(added), dtype=float)


def test_unknown_cause_is_the_kind_that_the_readings_show():
    causes = UnknownCauses.in_runs(healthy())
    result = _result(_wandering(2))
    posterior = result.selection.posterior(replace(result.state, strength=np.ones_like(result.state.strength)))
    gains = causes.gains(posterior)
    assert total_gain(gains) > 100 and likeliest_kind(gains) == "an error of axis 2 over its angle"
    sound = _result(np.zeros(len(healthy().y)))
    assert total_gain(causes.gains(sound.posterior)) < 0


def test_backlash_of_the_readings_wins_and_one_that_imitates_an_unknown_cause_loses():
    play = Backlash(axis=1, width_deg=0.05)
    (present,) = hypotheses_of(_result(shown_by(healthy(), [play]), play))
    assert present.log_odds() > 20
    (absent,) = hypotheses_of(_result(_wandering(2), play))
    assert absent.log_odds() < 0 and probabilities_of(absent).strongest == "unknown"


def test_usual_effect_beside_an_unknown_cause_is_compared_at_the_same_noise():
    (absent,) = hypotheses_of(_result(_wandering(2), TransmissionError(axis=1, order=30, amplitude_deg=0.003)))
    assert absent.log_odds() < 0


def test_offsets_of_parallel_axes_are_twins_at_different_sizes():
    offsets = [LinkGeometry(axis=axis, field="d", delta=2.0) for axis in (2, 3)]
    result = _result(shown_by(healthy(), offsets[:1]), offsets[0])
    rival = result.selection.initial_state((offsets[1],))
    larger = offsets[1].model_copy(update={"delta": 1.2 * rival.effects[0].delta})
    refined = replace(rival.refined, effects=(larger,), residual=result.linear.residual((larger,)))
    odds = (RivalOdds(0.5, ((replace(rival, refined=refined), 0.5),)),)
    (found,) = hypotheses_of(replace(result, rival_odds=odds))
    assert found.twins == [larger] and not found.rivals


def test_commanded_angles_are_an_alternative_to_an_error_of_the_arm():
    play = Backlash(axis=1, width_deg=0.05)
    (found,) = hypotheses_of(_result(shown_by(healthy(), [play]), play), only_commanded=True)
    assert probabilities_of(found).name < CONFIRMED and probabilities_of(found).strongest == "commanded"
