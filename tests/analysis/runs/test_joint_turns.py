import numpy as np
import pytest

from analysis.runs.joint_turns import beyond_limits, turns_further, without_whole_turns
from analysis.runs.tables import PoseTable
from rigs.load import load

RIG = load("ur10e")[0].model_copy(update={"effects": ()})
LIMITS = np.radians([-360.0, 360.0])
RNG = np.random.default_rng(8)


def table(counted: int) -> PoseTable:
    q = np.radians(RNG.uniform(-60, 60, (40, 6)))
    q[30:, 3] += counted * 2 * np.pi
    return PoseTable(q, RNG.normal(size=(40, 3)), None)


@pytest.mark.parametrize("counted", [-1, 1])
def test_rows_a_whole_turn_away_are_counted_back_and_named(counted):
    turned, doubts = without_whole_turns(table(counted), RIG)
    assert np.ptp(np.degrees(turned.q[:, 3])) < 120
    assert len(doubts) == 1 and "axis 4" in doubts[0] and "rows 31 to 40" in doubts[0]


def test_rows_one_turn_lower_are_corrected_together():
    """The angle of -354° is a turn too low, like those below -360°, but within the limits of 360°."""
    angle = np.concatenate([RNG.uniform(-170, 170, 40), [-466.8, -400.0, -380.0, -354.1]])
    assert turns_further(np.radians(angle), LIMITS).tolist() == [0] * 40 + [-1] * 4
    typo = np.radians(np.append(RNG.uniform(-350, 350, 60), 400.0))
    assert turns_further(typo, LIMITS).tolist() == [0] * 60 + [1]  # the joint really turns


def test_joint_outside_its_limits_is_named_with_rows_and_value():
    one = table(0)
    one.q[4, 1] = np.radians(400.0)
    (doubt,) = beyond_limits(one, RIG)
    assert "axis 2" in doubt and "400.0°" in doubt and "in row 5" in doubt
    assert beyond_limits(table(0), RIG) == ()
