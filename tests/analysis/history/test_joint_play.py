"""The play of a joint comes out of one lap, whatever else the robot has."""

from __future__ import annotations

import pytest

from analysis import evaluate, simulate
from analysis.history.joint_play import joint_plays
from rigs.effects import Backlash, TransmissionError
from rigs.schema.vocabulary import Direction


@pytest.mark.parametrize("direction", ["acw", "cw"])
@pytest.mark.parametrize(("axis", "width_deg"), [(1, 0.010), (1, 0.024), (3, 0.012)])
def test_a_play_is_found_at_its_joint(axis: int, width_deg: float, direction: Direction) -> None:
    wave = TransmissionError(axis=2, order=1, amplitude_deg=0.01)
    run = simulate("ur10e", "yaw", direction, seed=1, effects=[Backlash(axis=axis, width_deg=width_deg), wave])
    plays = joint_plays(evaluate(run))
    found = plays[f"play_j{axis}_deg"]
    assert found.value == pytest.approx(width_deg, abs=max(3 * found.u, 0.001))
    assert found.u < 0.2 * width_deg and found.unit == "deg"
    others = [one for name, one in plays.items() if name != f"play_j{axis}_deg"]
    assert others and all(abs(one.value) < max(3 * one.u, 0.003) for one in others)


def test_other_tests_have_no_plays() -> None:
    assert joint_plays(evaluate(simulate("ur10e", "repeatability", seed=1))) == {}
