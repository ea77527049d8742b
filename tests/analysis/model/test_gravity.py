"""Gravity by virtual work: the torque on a joint is the slope of the potential energy, by differences of frames."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.kinematics.arm import Arm, Array, link_frames
from analysis.model.gravity import Load, torques
from tests.support.five_arms import ARMS, calibrated

G = 9.80665
STEP = 1e-4


def _energy(arm: Arm, load: Load, q: Array) -> Array:
    """Potential energy (n,) in Nmm of links and payload, as far as gravity acts along -z of the world."""
    frames = link_frames(arm, q)
    centres = np.einsum("nkij,kj->nki", frames[:, :, :3, :3], load.centre) + frames[:, :, :3, 3]
    return G * (centres[..., 2] @ load.mass + load.payload_kg * frames[:, 5, 2, 3])


@pytest.mark.parametrize("name", ARMS)
def test_torques_are_the_slope_of_the_potential_energy(name: str) -> None:
    rng = np.random.default_rng(3)
    arm = replace(calibrated(ARMS[name], seed=2), coupling=np.eye(6) + 0.2 * rng.normal(size=(6, 6)))
    load = Load(rng.uniform(1, 40, 6), rng.normal(0, 100, (6, 3)), payload_kg=7.5)
    q = rng.uniform(-3, 3, (2000, 6))
    found = torques(arm, load, q)
    assert found.shape == (2000, 6)
    for joint, step in enumerate(STEP * np.eye(6)):
        slope = (_energy(arm, load, q + step) - _energy(arm, load, q - step)) / (2 * STEP)
        np.testing.assert_allclose(found[:, joint], -slope / 1000, atol=1e-4)


def test_an_arm_that_weighs_nothing_has_no_torque() -> None:
    arm, q = ARMS["ur10e"], np.random.default_rng(4).uniform(-3, 3, (50, 6))
    nothing = Load(np.zeros(6), np.zeros((6, 3)), 0.0)
    assert (torques(arm, nothing, q) == 0).all()
    assert (torques(arm, replace(nothing, payload_kg=2.0), q) != 0).any()
