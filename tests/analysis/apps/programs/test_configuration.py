import numpy as np
import pytest

from analysis.apps.makers.configuration import configuration_of, turns
from analysis.robot.kinematics.arm import forward
from analysis.robot.kinematics.inverse import inverse
from tests.support.five_arms import ARMS


@pytest.mark.parametrize("name", ["paper-fanuc", "FANUC M-16iB/20", "ABB IRB 2400/10", "KUKA KR 6 R700"])
def test_the_eight_solutions_of_a_pose_have_eight_configurations(name):
    arm = ARMS[name]
    for q in np.random.default_rng(1).uniform(-1.0, 1.0, (20, 6)):
        solutions = inverse(arm, forward(arm, q[None]))
        found = solutions.q[solutions.found]
        assert len({configuration_of(arm, one) for one in found}) == len(found)


def test_a_wrist_that_is_turned_over_is_flipped():
    arm = ARMS["paper-fanuc"]
    q = np.radians([10, 20, 10, 30, -50, 20])
    over = q + np.array([0, 0, 0, np.pi, -2 * q[4], np.pi])
    assert forward(arm, over[None]) == pytest.approx(forward(arm, q[None]))
    assert configuration_of(arm, q) == (False, True, True)
    assert configuration_of(arm, over) == (True, True, True)


@pytest.mark.parametrize(
    ("deg", "count"), [(-540, -2), (-539, -1), (-180, -1), (-179, 0), (0, 0), (179, 0), (180, 1), (539, 1), (541, 2)]
)
def test_turns_are_counted_from_half_a_turn_on(deg, count):
    assert turns(float(np.radians(deg))) == count
