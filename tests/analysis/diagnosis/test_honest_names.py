from dataclasses import replace
from functools import cache

import pytest

from analysis.diagnosis.evidence.gather import prepare_runs
from analysis.diagnosis.fit.search import SearchResult, search
from analysis.diagnosis.judge.result import Gap
from analysis.diagnosis.judge.verdict import (
    Gaps,
    _missed_elsewhere_um,  # private: the rest of the remainder needs a search
)
from analysis.procedures.simulate import simulate
from rigs.effects import Backlash, Effect, TransmissionError
from rigs.load import load
from rigs.schema.effect import label_of, size_of
from tests.support.diagnosis_cells import healthy, measured

WAYS = ("acw", "cw")


@cache
def _searched(effects: tuple[Effect, ...], times: int, seed: int) -> SearchResult:
    """The search in yaw runs of a UR10e with hidden effects, driven some times each way."""
    rig, _ = load("ur10e")
    runs = [
        measured(simulate(rig, "yaw", way, seed + k, effects), "yaw", f"yaw-{way}-{k}", rig)
        for k in range(times)
        for way in WAYS
    ]
    return search(prepare_runs(rig, runs, [], [])[0][0], lambda _: None)


_GEAR = TransmissionError(axis=6, order=2, amplitude_deg=0.01)


def test_a_usual_gear_error_is_not_called_a_fault_of_the_ball():
    result = _searched((Backlash(axis=1, width_deg=0.008), _GEAR), 1, 1)
    odds = {label_of(effect): of for effect, of in zip(result.effects, result.rival_odds, strict=True)}
    gear = odds["transmission_error 6 order 2"]
    rivals = {tried.effects[-1].effect: share for tried, share in gear.rivals}
    assert gear.odds > 0.5 and "ball_form" not in {effect.effect for effect in result.effects}
    assert 0.02 < rivals["ball_form"] < 0.5  # one yaw lap each way does not exclude it


def test_a_gear_error_once_a_turn_is_not_called_a_fault_of_the_gauges():
    gear = TransmissionError(axis=6, order=1, amplitude_deg=0.022, phase_deg=-92.2)
    result = _searched((gear,), 2, 500)
    assert [label_of(effect) for effect in result.effects] == ["transmission_error 6 order 1"]
    assert size_of(result.effects[0]) == pytest.approx(size_of(gear), rel=0.05)


def test_errors_at_other_places_are_unexplained_if_repeats_state_the_noise():
    gap = Gap(("a",), before_um=200.0, after_um=90.0, noise_floor_um=50.0, calibrated_um=50.0)
    (block, *_) = healthy().blocks
    repeated, once = [replace(block, measured=True)], [replace(block, measured=False)]
    missed = Gaps(gap, None, None, unexplained_um=30.0, beyond_um=45.0)
    assert _missed_elsewhere_um(missed, repeated) == 45.0
    assert _missed_elsewhere_um(missed, once) == 0.0  # it may be scatter
    assert _missed_elsewhere_um(replace(missed, beyond_um=40.0), repeated) == 0.0  # sound cells have as much
    assert _missed_elsewhere_um(replace(missed, unexplained_um=60.0), once) == 60.0
