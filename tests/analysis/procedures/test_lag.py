import pytest

from analysis.procedures.direction_pair import lag_of
from analysis.procedures.shared.lap_curve import LapCurve, curve_of, reduced
from analysis.procedures.simulate import simulate
from analysis.runs.laps import laps_of
from rigs.effects import Effect, TimeLag
from rigs.load import load, load_hidden
from rigs.rig import Rig
from rigs.schema.vocabulary import Direction


def distance(rig: Rig, direction: Direction, seed: int | None, effects: list[Effect]) -> LapCurve:
    laps = laps_of(simulate(rig, "yaw", direction, seed, effects), rig, direction)
    return curve_of(reduced(laps), lambda g_mm: g_mm.mean(axis=-1), 1.0)


@pytest.mark.parametrize("lag_s", [0.005, -0.02, 0.0])
def test_lag_is_found_without_other_reversals(lag_s):
    rig = load_hidden("ur10e").apply_to(load("ur10e")[0])
    effects: list[Effect] = [TimeLag(effect="time_lag", lag_s=lag_s)] if lag_s else []
    acw, cw = (distance(rig, direction, None, effects) for direction in ("acw", "cw"))
    found = lag_of([(acw, cw)], [1.0], 100)
    assert found.value == pytest.approx(1e3 * lag_s, abs=0.2)
    assert 1 < found.u < 60  # a different run never meets the ball at quite the same place
