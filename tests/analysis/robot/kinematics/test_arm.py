import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analysis.robot.kinematics.arm import (
    cos_sin,
    forward,
    forward_and_jacobian,
    link_frames,
    pose_error,
    roll_pitch_yaw,
    rotation,
    transform,
    transforms,
)
from rigs.schema.robot import Pose
from tests.support.five_arms import ARMS, OPW, PeerArm, pose_apart
from tests.support.postures import everywhere, random_angles

ANY = pytest.mark.parametrize("name", ARMS)


def _rot(axis: str, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    T = np.eye(4)
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    T[i, i] = T[j, j] = c
    T[j, i], T[i, j] = s, -s
    return T


def _trans(x: float = 0.0, z: float = 0.0) -> np.ndarray:
    T = np.eye(4)
    T[0, 3], T[2, 3] = x, z
    return T


@ANY
def test_forward_is_craigs_product_with_hayatis_angle(name):
    rng = np.random.default_rng(1)
    arm = dataclasses.replace(ARMS[name], beta=rng.normal(0, 0.1, 6), coupling=rng.normal(0, 1, (6, 6)))
    q = rng.uniform(-3, 3, (20, 6))
    T = forward(arm, q)
    for row, angles in enumerate(q):
        theta = arm.coupling @ angles + arm.offset
        expected = arm.T_world_base
        for k in range(6):
            expected = expected @ _rot("x", arm.alpha[k]) @ _trans(x=arm.a[k]) @ _rot("y", arm.beta[k])
            expected = expected @ _rot("z", theta[k]) @ _trans(z=arm.d[k])
        np.testing.assert_allclose(T[row], expected @ arm.T_flange_tool, atol=1e-9)


@ANY
def test_jacobian_is_the_slope_of_forward(name):
    arm = ARMS[name]
    q = np.random.default_rng(2).uniform(-2, 2, (10, 6))
    _, J = forward_and_jacobian(arm, q)
    h = 1e-6
    for axis in range(6):
        step = np.zeros(6)
        step[axis] = h
        slope = pose_error(forward(arm, q - step), forward(arm, q + step)) / (2 * h)
        np.testing.assert_allclose(J[:, :, axis], slope, rtol=1e-6, atol=1e-4)


@pytest.mark.parametrize("name", OPW)
def test_forward_and_jacobian_are_the_peers(name):
    q = everywhere(name)
    T, J = forward_and_jacobian(ARMS[name], q)
    peer = PeerArm(OPW[name])
    mm, rad = pose_apart(T, peer.forward(q))
    assert mm < 1e-8
    assert rad < 1e-10
    off = np.abs(J - peer.jacobian(q))
    assert off[:, :3].max() < 1e-8
    assert off[:, 3:].max() < 1e-10


@ANY
def test_a_large_stack_is_its_rows(name):
    arm, q = ARMS[name], random_angles(3, 10_001)
    T, J = forward_and_jacobian(arm, q)
    frames = link_frames(arm, q)
    np.testing.assert_array_equal(forward(arm, q), T)
    for row in (0, 1, 1499, 1500, 2999, 3000, 5000, 9999, 10_000):
        alone, J_alone = forward_and_jacobian(arm, q[row : row + 1])
        np.testing.assert_allclose(alone[0], T[row], rtol=0, atol=1e-11)
        np.testing.assert_allclose(J_alone[0], J[row], rtol=0, atol=1e-11)
        np.testing.assert_allclose(link_frames(arm, q[row : row + 1])[0], frames[row], rtol=0, atol=1e-11)
    assert forward(arm, q[:0]).shape == (0, 4, 4)


def test_cosine_and_sine_are_those_of_the_library_to_rounding():
    quarters = np.pi / 2 * np.arange(-16, 17)
    angle = np.concatenate([quarters, np.nextafter(quarters, 9), np.linspace(-20, 20, 100_001), [1e-300, 0.0]])
    cosine, sine = cos_sin(angle)
    assert np.abs(cosine - np.cos(angle)).max() < 1e-15
    assert np.abs(sine - np.sin(angle)).max() < 1e-15
    assert np.isnan(cos_sin(np.array([np.nan]))).all()


@pytest.mark.parametrize("below_90_deg", [90.0, 1.0, 1e-6, 1e-10, 1e-13, 0.0])
@pytest.mark.parametrize("sign", [1, -1])
def test_roll_pitch_yaw_makes_the_frame_again(below_90_deg, sign):
    rng = np.random.default_rng(6)
    rolls, yaws = rng.uniform(-180, 180, (2, 50))
    given = [(roll, sign * (90 - below_90_deg), yaw) for roll, yaw in zip(rolls, yaws, strict=True)]
    T = np.stack([transform(Pose(xyz_mm=(1, 2, 3), rpy_deg=one)) for one in given])
    found = np.degrees(roll_pitch_yaw(T))
    again = np.stack([transform(Pose(xyz_mm=(1, 2, 3), rpy_deg=tuple(one))) for one in found])
    np.testing.assert_allclose(again, T, atol=1e-12)
    if below_90_deg >= 1:
        np.testing.assert_allclose(found, given, atol=1e-9)


def test_a_rotation_vector_is_that_of_scipy():
    directions = np.random.default_rng(4).normal(size=(40, 3))
    for size in (1e-12, 1e-6, 1e-3, 1.0, 3.0):
        expected = Rotation.from_rotvec(size * directions).as_matrix()
        np.testing.assert_allclose(rotation(size * directions), expected, atol=2e-15)
    np.testing.assert_array_equal(rotation(np.zeros(3)), np.eye(3))


def test_frames_of_many_poses_are_those_of_scipy():
    poses = np.random.default_rng(5).uniform(-180, 180, (30, 6))
    np.testing.assert_allclose(
        transforms(poses)[:, :3, :3], Rotation.from_euler("xyz", poses[:, 3:], degrees=True).as_matrix(), atol=1e-14
    )
    np.testing.assert_array_equal(transforms(poses)[:, :3, 3], poses[:, :3])
