from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from analysis.robot.kinematics.arm import Arm, forward
from analysis.robot.kinematics.inverse import Solutions, inverse
from analysis.robot.kinematics.joint_limits import within_limits
from analysis.robot.kinematics.newton import conditioning
from tests.support.five_arms import ARMS, OPW, Opw, PeerArm, apart, calibrated, pose_apart
from tests.support.postures import SINGULARITY_DISTANCES_RAD, at_limits, everywhere, random_angles, rows, singular

ANY = pytest.mark.parametrize("name", ARMS)


def _holds(arm: Arm, poses: np.ndarray, solutions: Solutions) -> None:
    """Every solution gives its pose back, is not there twice, and is wrapped; where there is none is nan."""
    q, found = solutions.q, solutions.found
    mm, rad = pose_apart(forward(arm, q[found]), poses[rows(found)])
    assert mm < 1e-8
    assert rad < 1e-10
    assert np.isnan(q[~found]).all()
    assert np.abs(q[found] @ arm.coupling.T).max(initial=0.0) < np.pi + 1e-9
    for slot in range(1, q.shape[1]):
        twice = (apart(arm, q[:, :slot], q[:, slot, None]) < 1e-6) & found[:, :slot] & found[:, slot, None]
        assert not twice.any()


def _missing(arm: Arm, solutions: Solutions, q: np.ndarray, near: float = 1e-6) -> np.ndarray:
    """Rows of planted q (n, 6) that are not among the solutions."""
    return ~((apart(arm, solutions.q, q[:, None]) < near) & solutions.found).any(axis=1)


@ANY
def test_every_solution_gives_its_pose_back(name):
    arm = ARMS[name]
    poses = forward(arm, everywhere(name))
    solutions = inverse(arm, poses)
    assert solutions.complete
    assert solutions.q.shape == (len(poses), 8, 6)
    assert solutions.found.any(axis=1).all()
    _holds(arm, poses, solutions)


@pytest.mark.parametrize("name", OPW)
def test_no_branch_of_the_peer_is_missing(name):
    arm, q = ARMS[name], np.concatenate([random_angles(13), at_limits(name)])
    q = q[conditioning(arm, q) > 1e-6]
    poses = forward(arm, q)
    solutions, peers = inverse(arm, poses), PeerArm(OPW[name]).inverse(poses)
    found = np.isfinite(peers[..., 0])
    assert found.sum() > 7 * 0.9 * len(q)
    for slot in range(8):
        assert not (_missing(arm, solutions, peers[:, slot]) & found[:, slot]).any()


@pytest.mark.parametrize("name", OPW)
@pytest.mark.parametrize("where", ["wrist", "stretched", "folded"])
def test_the_peers_arm_postures_are_ours_at_singularities(name, where):
    """Axes 4 and 6 share one angle at a singular wrist, so the arm's three axes are what can be compared."""
    arm, poses = ARMS[name], forward(ARMS[name], singular(name)[where])
    solutions, peers = inverse(arm, poses), PeerArm(OPW[name]).inverse(poses)
    off = np.abs(np.exp(1j * solutions.q[:, :, None, :3]) - np.exp(1j * peers[:, None, :, :3])).max(axis=3)
    matched = ((off < 1e-5) & solutions.found[:, :, None]).any(axis=1)
    assert matched[np.isfinite(peers[..., 0])].all()


@pytest.mark.parametrize("name", OPW)
def test_a_singular_wrist_has_theta_4_of_the_choice(name):
    arm = ARMS[name]
    q = singular(name)["wrist"][::8]
    solutions = inverse(arm, forward(arm, q))
    turned = (solutions.q @ arm.coupling.T + arm.offset)[solutions.found]
    straight = np.abs(np.sin(turned[:, 4])) < 1e-12
    assert straight.any()
    assert np.abs(np.sin(turned[straight, 3])).max() < 1e-9


@pytest.mark.parametrize("name", OPW)
def test_wrist_centre_on_axis_1_keeps_the_chosen_theta_1(name):
    arm = ARMS[name]
    q = singular(name)["shoulder"][:: len(SINGULARITY_DISTANCES_RAD)]
    solutions = inverse(arm, forward(arm, q))
    turned = (solutions.q @ arm.coupling.T + arm.offset)[solutions.found]
    assert np.abs(np.sin(turned[:, 0])).max() < 1e-12


@ANY
def test_couplings_bases_and_reversed_axes_do_not_matter(name):
    rng = np.random.default_rng(5)
    arm = ARMS[name]
    flipped = np.array([0, 1, 0, 1, 1, 0])
    arm = replace(
        arm,
        coupling=np.eye(6) + 0.3 * rng.normal(size=(6, 6)),
        alpha=arm.alpha + np.pi * np.diff(flipped, prepend=0) + np.array([0.7, 0, 0, 0, 0, 0]),
        a=arm.a + np.array([80.0, 0, 0, 0, 0, 0]),
        beta=np.array([0.4, 0, 0, 0, 0, 0]),
        d=arm.d + np.array([0, 30.0, -75, 0, 0, 0]),
        T_world_base=forward(arm, rng.normal(size=(1, 6)))[0],
        T_flange_tool=forward(arm, rng.normal(size=(1, 6)))[0],
    )
    q = random_angles(14, 1000)
    solutions = inverse(arm, forward(arm, q))
    assert solutions.complete
    _holds(arm, forward(arm, q), solutions)
    assert not _missing(arm, solutions, q).any()


def test_staublis_lateral_offset():
    """TX40 of opw_parameters_examples.h: b = 35, no a1, links of one length."""
    opw = Opw(*(0, 0, 35, 320, 225, 225, 65), (0, 0, -90, 0, 0, 0), (1,) * 6, np.eye(6))
    q = random_angles(15, 2000)
    poses = forward(opw.arm(), q)
    np.testing.assert_allclose(poses, PeerArm(opw).forward(q), atol=1e-9)
    solutions = inverse(opw.arm(), poses)
    _holds(opw.arm(), poses, solutions)
    assert not _missing(opw.arm(), solutions, q).any()


@ANY
def test_planted_angles_of_a_calibrated_arm_are_found(name):
    arm = calibrated(ARMS[name], seed=6)
    q = random_angles(16, 1000)
    solutions = inverse(arm, forward(arm, q))
    assert not solutions.complete
    _holds(arm, forward(arm, q), solutions)
    missing = _missing(arm, solutions, q, near=1e-5)
    assert missing.sum() <= 2
    assert not missing[conditioning(arm, q) > 1e-3].any()


def test_an_arm_of_no_known_kind_is_searched():
    arm = replace(ARMS["ur10e"], alpha=np.radians([0.0, 70, 20, -40, 80, -60]))
    q = random_angles(17, 50)
    solutions = inverse(arm, forward(arm, q))
    assert solutions.q.shape == (50, 16, 6)
    assert not solutions.complete
    _holds(arm, forward(arm, q), solutions)
    assert _missing(arm, solutions, q, near=1e-5).sum() <= 1


@ANY
def test_unreachable_and_nan_targets_have_no_solution(name):
    for arm in (ARMS[name], calibrated(ARMS[name], seed=8)):
        poses = forward(arm, np.full((4, 6), 0.3))
        poses[0, :3, 3] += 9000
        poses[1, 0, 3], poses[2, 1, 1] = np.nan, np.inf
        assert inverse(arm, poses).found.any(axis=1).tolist() == [False, False, False, True]
        assert inverse(arm, poses[:0]).q.shape[0] == 0


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
