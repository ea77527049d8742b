from dataclasses import replace

import numpy as np
import pytest

from analysis.robot.kinematics.arm import Arm, forward
from analysis.robot.kinematics.follow import follow
from analysis.robot.kinematics.inverse import inverse
from analysis.robot.kinematics.joint_limits import within_limits
from analysis.robot.kinematics.newton import cancelling_axes, from_nearby, newton
from tests.support.five_arms import ARMS, calibrated, pose_apart
from tests.support.postures import random_angles
from tests.support.refusals import refused

ANY = pytest.mark.parametrize("name", ARMS)
START = np.radians([10.0, 40, -20, 30, 50, 20])
UPRIGHT_IS_ZERO = {"paper-fanuc", "ABB IRB 2400/10", "FANUC M-16iB/20"}
"""Axis 2, that is; the others have it level."""


def _path(arm: Arm, start: np.ndarray, swing_deg: float, n: int = 400) -> tuple[np.ndarray, np.ndarray]:
    s = np.linspace(0, 1, n)[:, None]
    q = start + np.radians(swing_deg) * np.sin(2 * np.pi * s * np.array([1, 0.7, 0.5, 1.2, 0.4, 1.5]))
    return q, forward(arm, q)


@ANY
@pytest.mark.parametrize("seed", [None, 4])
def test_long_path_is_followed_from_any_turn_of_its_posture(name, seed):
    """Whole turns of the posture stay: the branches that it is compared with have none."""
    arm = ARMS[name] if seed is None else calibrated(ARMS[name], seed)
    arm = replace(arm, limits=np.tile([-9.0, 9.0], (6, 1)))
    start = START if name in UPRIGHT_IS_ZERO else np.radians([10.0, -70, 60, 40, 60, 20])
    turns = 2 * np.pi * np.linalg.inv(arm.coupling) @ [1, 0, 0, -1, 0, 1]
    q, poses = _path(arm, start, 25, n=5000)
    np.testing.assert_allclose(follow(arm, poses, start + turns + 0.02, "path"), q + turns, atol=1e-9)


@pytest.mark.parametrize("n", [400, 10])
def test_a_path_straight_through_a_singular_wrist_keeps_axis_4(n):
    """Axis 5 passes zero and the others go on: the branch of the closed form changes, the arm does not jump."""
    arm = ARMS["ABB IRB 2400/10"]
    q = np.tile(np.radians([10.0, 20, 10, 0, 0, 30]), (n, 1))
    q[:, 4] = np.linspace(0.3, -0.3, n)
    q[:, 0] += np.linspace(0, 0.2, n)
    np.testing.assert_allclose(follow(arm, forward(arm, q), q[0], "path"), q, atol=1e-5)


def _lost(arm: Arm) -> tuple[np.ndarray, np.ndarray]:
    """Poses (m, 4, 4) that Newton does not reach from the postures (m, 6) beside them."""
    rng = np.random.default_rng(0)
    poses, posture = forward(arm, rng.uniform(-1.2, 1.2, (400, 6))), rng.uniform(-2, 2, (400, 6))
    rows = np.flatnonzero(~newton(arm, poses, posture)[1])[:5]
    assert len(rows) == 5
    return poses[rows], posture[rows]


def test_newton_restarts_from_the_nearest_branch():
    arm = ARMS["paper-fanuc"]
    for pose, posture in zip(*_lost(arm), strict=True):
        begun = follow(arm, pose[None], posture, "path")[0]
        turned, _ = within_limits(arm, inverse(arm, pose[None]).q[0])
        np.testing.assert_allclose(begun, turned[np.abs(turned - posture).max(axis=1).argmin()], atol=1e-9)


def test_pose_of_another_posture_is_refused():
    arm = ARMS["paper-fanuc"]
    for pose, posture in zip(*_lost(arm), strict=True):
        with refused("path.impossible", "arm changes its posture near pose"):
            follow(arm, np.stack([forward(arm, posture[None])[0], pose]), posture, "path")


def test_path_out_of_reach_names_the_place():
    arm = ARMS["ABB IRB 2400/10"]
    poses = np.repeat(forward(arm, START[None]), 100, axis=0)
    poses[:, 0, 3] += np.linspace(0, 3000, 100)
    with refused("path.impossible", "of the arm in every posture"):
        follow(arm, poses, START, "path")


def test_joint_limit_on_the_way_is_refused():
    arm = ARMS["KUKA KR 6 R700"]
    limits = arm.limits.copy()
    limits[3, 1] = np.radians(40)
    _, poses = _path(arm, START, 25)
    with refused("path.impossible", "beyond the limits"):
        follow(replace(arm, limits=limits), poses, START, "path")


def test_singular_wrist_names_its_axes():
    """The tool tips past the axis of the forearm, 0.0001° beside it: axis 4 would have to turn half round at once."""
    arm = ARMS["ABB IRB 2400/10"]
    q = np.tile(np.radians([10.0, 20, 10, 0, 0, 30]), (201, 1))
    beside = np.radians(1e-4)
    tip = np.linspace(-0.3, 0.3, 201)
    q[:, 4], q[:, 3] = np.hypot(tip, beside), np.arctan2(beside, tip)
    q[:, 5] -= q[:, 3]
    assert cancelling_axes(arm, q[100]) == [4, 6]
    with refused("path.impossible", "arm changes its posture near pose"):
        follow(arm, forward(arm, q), q[0], "path")


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
