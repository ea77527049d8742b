from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from analysis.robot.kinematics.arm import Arm, forward
from analysis.robot.kinematics.inverse import inverse
from analysis.robot.kinematics.joint_limits import within_limits
from analysis.robot.kinematics.newton import conditioning
from tests.support.five_arms import ARMS
from tests.support.postures import at_limits, random_angles

ANY = pytest.mark.parametrize("name", ARMS)


def _by_trial(arm: Arm, q: np.ndarray, most: int) -> np.ndarray:
    turns = np.array(list(product(range(-most, most + 1), repeat=6))) * 2 * np.pi
    turned = q + turns @ np.linalg.inv(arm.coupling).T
    return turned[((turned >= arm.limits[:, 0]) & (turned <= arm.limits[:, 1])).all(axis=1)]


@pytest.mark.parametrize("name", ["ur10e", "FANUC M-16iB/20"])
def test_every_turn_within_the_limits_is_there(name):
    arm = ARMS[name]
    q = random_angles(21, 5)
    turned, row = within_limits(arm, q)
    for index in range(len(q)):
        expected = _by_trial(arm, q[index], 3)
        mine = turned[row == index]
        assert len(mine) == len(expected)
        np.testing.assert_allclose(mine[np.lexsort(mine.round(6).T)], expected[np.lexsort(expected.round(6).T)])


def test_a_coupling_that_mixes_turns():
    rng = np.random.default_rng(4)
    arm = replace(ARMS["ur10e"], coupling=np.round(np.eye(6) + 0.4 * rng.normal(size=(6, 6)), 1))
    q = rng.uniform(-1, 1, (3, 6))
    turned, row = within_limits(arm, q)
    for index in range(len(q)):
        assert len(turned[row == index]) == len(_by_trial(arm, q[index], 3))
    np.testing.assert_allclose(forward(arm, turned), forward(arm, q[row]), atol=1e-9)


@ANY
def test_angle_on_a_limit_is_within(name):
    arm = ARMS[name]
    q = at_limits(name)
    q = q[conditioning(arm, q) > 1e-6]
    solutions = inverse(arm, forward(arm, q))
    turned, row = within_limits(arm, solutions.q.reshape(-1, 6))
    for index, planted in enumerate(q):
        mine = turned[row // 8 == index]
        assert np.abs(mine - planted).max(axis=1).min() < 1e-6


def test_nan_and_unreachable_turns_are_left_out():
    arm = ARMS["ABB IRB 2400/10"]
    q = np.zeros((3, 6))
    q[0] = np.nan
    q[1, 1] = np.radians(121)
    turned, row = within_limits(arm, q)
    assert set(row.tolist()) == {2}
    assert len(turned) == 1
