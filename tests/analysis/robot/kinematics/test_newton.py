import numpy as np
import pytest

from analysis.robot.kinematics.arm import forward
from analysis.robot.kinematics.newton import from_nearby, newton
from tests.support.five_arms import ARMS, calibrated, pose_apart
from tests.support.postures import random_angles

COUNT = 2_500
"""More than a block."""


@pytest.mark.parametrize("name", ARMS)
def test_near_targets_are_reached_and_far_ones_keep_the_start(name):
    arm = calibrated(ARMS[name], 3)
    q = random_angles(3, COUNT)
    poses = forward(arm, q)
    far = np.arange(COUNT) % 7 == 0
    start = np.where(far[:, None], q + 1.0, q + np.random.default_rng(3).uniform(-1e-3, 1e-3, q.shape))
    reached, off_mm, regularity = from_nearby(arm, poses, start, within_mm=20.0)
    there = off_mm < 1e-9
    assert np.array_equal(reached[far], start[far]) and np.isinf(off_mm[far]).all()
    assert there[~far].mean() > 0.99  # all but what lies at a singularity
    mm, rad = pose_apart(forward(arm, reached[there]), poses[there])
    assert mm < 2e-9 and rad < 1e-11
    assert ((regularity[~far] > 0) & (regularity[~far] <= 1)).all()


def test_nan_targets_do_not_affect_others():
    arm = calibrated(ARMS["ur10e"], 4)
    q = random_angles(4, 20)
    poses, start = forward(arm, q), q + 1e-2
    start[3], poses[5, 0, 0] = np.nan, np.nan
    reached, good = newton(arm, poses, start)
    assert np.flatnonzero(~good).tolist() == [3, 5]
    assert pose_apart(forward(arm, reached[good]), poses[good])[0] < 1e-6
    assert np.array_equal(reached[5], start[5])


def test_a_pose_at_a_singularity_has_a_step_too():
    arm = ARMS["ur10e"]
    q = random_angles(5, 50)
    q[:, 4] = 0.0
    poses = forward(arm, q)
    reached, good = newton(arm, poses, q + 1e-3)
    assert np.isfinite(reached).all()
    assert good.mean() > 0.9
