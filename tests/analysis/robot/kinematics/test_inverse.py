"""All-branches inverse kinematics: poses given back, planted angles found, no branch of the peer missing."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.robot.kinematics.arm import Arm, forward
from analysis.robot.kinematics.inverse import Solutions, inverse
from analysis.robot.kinematics.newton import conditioning, newton
from tests.support.five_arms import ARMS, J2_IN_J3, OPW, Opw, PeerArm, apart, calibrated, pose_apart
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


@ANY
def test_planted_angles_are_among_the_branches(name):
    arm = ARMS[name]
    q = np.concatenate([random_angles(12), at_limits(name)])
    q = q[conditioning(arm, q) > 1e-6]
    solutions = inverse(arm, forward(arm, q))
    assert not _missing(arm, solutions, q).any()
    assert (solutions.found.sum(axis=1) == 8).mean() > 0.7


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


@ANY
def test_branches_of_a_calibrated_arm_follow_from_the_ideal_ones(name):
    """From the ideal arm to the calibrated one in small steps, each solution by Newton from the one before: none that
    stays regular on the way is missing."""
    ideal, final = ARMS[name], calibrated(ARMS[name], seed=9)
    poses = forward(final, random_angles(19, 300))
    started = inverse(ideal, poses)
    row, slot = np.nonzero(started.found)
    q, regular = started.q[row, slot], np.ones(len(row), dtype=bool)
    for share in np.linspace(0.1, 1.0, 10):
        arm = replace(
            ideal,
            **{
                part: (1 - share) * getattr(ideal, part) + share * getattr(final, part)
                for part in ("a", "alpha", "beta", "d", "offset")
            },
        )
        q, good = newton(arm, poses[row], q)
        regular &= good
        regular[regular] &= conditioning(arm, q[regular]) > 3e-3
    assert regular.mean() > 0.85
    solutions = inverse(final, poses)
    near = (apart(final, solutions.q[row], q[:, None]) < 1e-6) & solutions.found[row]
    assert near.any(axis=1)[regular].all()


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


def test_pose_beyond_reach_has_no_solution_and_one_within_both_elbows():
    arm = ARMS["ABB IRB 2400/10"]
    q = singular("ABB IRB 2400/10")["stretched"][:1]
    pose = forward(arm, q)
    shoulder = np.array([100 * np.cos(q[0, 0]), 100 * np.sin(q[0, 0]), 615])
    wrist = (pose @ np.linalg.inv(arm.T_flange_tool))[0]
    outwards = wrist[:3, 3] - 85 * wrist[:3, 2] - shoulder
    outwards /= np.linalg.norm(outwards)
    for mm, elbows in ((1e-6, 0), (-1e-6, 2)):
        moved = pose.copy()
        moved[0, :3, 3] += mm * outwards
        solutions = inverse(arm, moved)
        near = np.abs(solutions.q[0, :, 0] - q[0, 0]) < 1e-6
        assert len(np.unique(solutions.q[0, near & solutions.found[0], 2].round(7))) == elbows


def test_the_coupling_of_fanuc_is_in_the_angles():
    coupled = ARMS["FANUC M-16iB/20"]
    plain = replace(coupled, coupling=coupled.coupling @ np.linalg.inv(J2_IN_J3))
    poses = forward(coupled, random_angles(18, 100))
    q, p = inverse(coupled, poses).q, inverse(plain, poses).q
    np.testing.assert_allclose(q[..., 2] + q[..., 1], p[..., 2], atol=1e-12)
