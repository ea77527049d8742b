from __future__ import annotations

import json

import numpy as np
import pytest

from analysis import evaluate, load_run
from analysis.apps.report.run_object import as_object, compare, lag_in_words, verdict
from analysis.procedures.direction_pair import lag_of
from analysis.procedures.pooled import pairs_of
from analysis.procedures.shared.lap_curve import LapCurve, curve_of, reduced
from analysis.procedures.simulate import simulate
from analysis.runs.laps import laps_of
from rigs.effects import Effect, TimeLag
from rigs.load import load, load_hidden
from rigs.rig import Rig
from rigs.schema.vocabulary import Direction
from tests.support.written_runs import write_simulated

LAGGING = TimeLag(effect="time_lag", lag_s=0.005)


def distance(rig: Rig, direction: Direction, seed: int | None, effects: list[Effect]) -> LapCurve:
    laps = laps_of(simulate(rig, "yaw", direction, seed, effects), rig, direction)
    return curve_of(reduced(laps), lambda g_mm: g_mm.mean(axis=-1), 1.0)


@pytest.mark.parametrize("lag_s", [0.005, -0.02, 0.0])
def test_a_lag_is_found_where_nothing_else_reverses(lag_s):
    rig = load_hidden("ur10e").apply_to(load("ur10e")[0])
    effects: list[Effect] = [TimeLag(effect="time_lag", lag_s=lag_s)] if lag_s else []
    acw, cw = (distance(rig, direction, None, effects) for direction in ("acw", "cw"))
    found = lag_of([(acw, cw)], [1.0], 100)
    assert found.value == pytest.approx(1e3 * lag_s, abs=0.2)
    assert 1 < found.u < 60  # a different run never meets the ball at quite the same place


def test_play_widens_the_uncertainty_that_covers_the_lag():
    """With the robot's own plays, and with noise and scatter of four pairs of runs."""
    rig = load_hidden("ur10e").apply_to(load("ur10e")[0])
    for effects, least_ms in (([LAGGING], 1.0), ([LAGGING, *rig.effects], 20.0)):
        off = []
        for seed in range(4):
            acw, cw = (distance(rig, direction, 2 * seed + k, effects) for k, direction in enumerate(("acw", "cw")))
            found = lag_of([(acw, cw)], [1.0], 100)
            assert found.u > least_ms
            off.append((found.value - 5) / found.u)
        assert np.max(np.abs(off)) <= 3


def test_lag_needs_two_directions(tmp_path):
    rig, text = load("ur10e")
    rig = load_hidden("ur10e").apply_to(rig)
    runs = list(write_simulated(rig, text, "yaw", ("acw", "cw"), [3], tmp_path, [LAGGING]))
    results = [evaluate(load_run(path)) for path in runs]
    (told,) = as_object(results)["acw_against_cw"]
    assert abs(told["lag"]["value"] - 5) <= 2 * told["lag"]["u"] and told["lag"]["unit"] == "ms"
    assert len(lag_in_words(pairs_of(results), results)) == len(lag_in_words(None, results[:1])) == 1
    assert as_object(results[:1])["acw_against_cw"] == []


def test_difference_from_truth_is_positive_where_the_figure_is_larger(tmp_path):
    rig, text = load("ur10e")
    rig = load_hidden("ur10e").apply_to(rig)
    result = evaluate(load_run(next(write_simulated(rig, text, "yaw", ("acw",), [3], tmp_path, ()))))
    figure = result.figures["band_deg"]
    truth = {"rig": "ur10e", "yaw": {"acw": {"band_deg": figure.value - 3 * figure.u}}}
    (tmp_path / "truth.json").write_text(json.dumps(truth))
    (found,) = compare([result], tmp_path / "truth.json")
    assert found["band_deg"].deviation_u == pytest.approx(3)
    assert verdict([found]).startswith("0 of 1 ")
