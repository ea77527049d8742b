from dataclasses import replace

import numpy as np
import pytest

from analysis.robot.kinematics.arm import Arm, Array, link_frames
from analysis.robot.predict import Load, pull
from tests.support.five_arms import ARMS, calibrated

G = 9.80665
STEP = 1e-4


def _energy(arm: Arm, load: Load, q: Array) -> Array:
    """Potential energy (n,) in Nmm of links and payload, as far as gravity acts along -z of the world."""
    frames = link_frames(arm, q)
    centres = np.einsum("nkij,kj->nki", frames[:, :, :3, :3], load.centre) + frames[:, :, :3, 3]
    return G * (centres[..., 2] @ load.mass + load.payload_kg * frames[:, 5, 2, 3])


@pytest.mark.parametrize("name", ARMS)
def test_torques_are_the_slope_of_the_potential_energy(name):
    rng = np.random.default_rng(3)
    arm = replace(calibrated(ARMS[name], seed=2), coupling=np.eye(6) + 0.2 * rng.normal(size=(6, 6)))
    load = Load(rng.uniform(1, 40, 6), rng.normal(0, 100, (6, 3)), payload_kg=7.5)
    q = rng.uniform(-3, 3, (2000, 6))
    found = pull(arm, load, q).torque
    assert found.shape == (2000, 6)
    for joint, step in enumerate(STEP * np.eye(6)):
        slope = (_energy(arm, load, q + step) - _energy(arm, load, q - step)) / (2 * STEP)
        np.testing.assert_allclose(found[:, joint], -slope / 1000, atol=1e-4)


def test_an_arm_that_weighs_nothing_has_no_torque():
    arm, q = ARMS["ur10e"], np.random.default_rng(4).uniform(-3, 3, (50, 6))
    nothing = Load(np.zeros(6), np.zeros((6, 3)), 0.0)
    assert (pull(arm, nothing, q).torque == 0).all()
    assert (pull(arm, replace(nothing, payload_kg=2.0), q).torque != 0).any()


def test_moment_on_the_base_is_that_of_all_weights():
    rng = np.random.default_rng(5)
    arm = calibrated(ARMS["ur10e"], seed=3)
    leaning = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = leaning * np.linalg.det(leaning), (300.0, -200.0, 900.0)
    arm = replace(arm, T_world_base=T)
    load = Load(rng.uniform(1, 40, 6), rng.normal(0, 100, (6, 3)), payload_kg=7.5)
    q = rng.uniform(-3, 3, (20, 6))
    frames = link_frames(arm, q)
    centres = np.einsum("nkij,kj->nki", frames[:, :, :3, :3], load.centre) + frames[:, :, :3, 3]
    at = np.concatenate([centres, frames[:, 5:, :3, 3]], axis=1) - T[:3, 3]
    forces = np.outer([*load.mass, load.payload_kg], [0, 0, -G])
    in_world = np.cross(at, forces[None]).sum(axis=1) / 1000
    np.testing.assert_allclose(pull(arm, load, q).moment, in_world @ T[:3, :3], atol=1e-9)
