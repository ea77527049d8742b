from dataclasses import replace

import numpy as np
import pytest

from analysis import calibrate
from analysis.procedures.simulate import simulated_run
from analysis.robot.kinematics.arm import arm_of, forward
from rigs.effects import Backlash, JointOffset, size_field
from rigs.load import load
from tests.worlds.arms.independent_arm import constants_of, flange, healthy, postures

LOADED, TEXT = load("paper-fanuc")
RIG = LOADED.model_copy(update={"effects": ()})


@pytest.mark.parametrize(
    ("truth", "words", "test"),
    [  # a play and a wave are fitted on yaw circles by the contract of every effect
        (Backlash(axis=1, width_deg=0.02), "backlash:1", "repeatability"),
        (JointOffset(axis=5, offset_deg=-0.1), "joint_offset:5", "radial"),
    ],
)
def test_planted_values_are_found(truth, words, test):
    (found,) = calibrate([simulated_run(RIG, TEXT, test, None, 1, (truth,))], words, rig=RIG).effects
    field = size_field(truth)
    off = abs(getattr(found.effect, field) - getattr(truth, field))
    assert off < 4 * found.sd[field] and off < 0.1 * abs(getattr(truth, field))


@pytest.mark.parametrize("name", ["paper-fanuc", "ur10e"])
def test_the_generator_means_the_same_arm(name):
    rng = np.random.default_rng(0)
    right = healthy(rng)
    right = replace(right, **{key: 0.0 * getattr(right, key) for key in right.__dataclass_fields__})
    q = postures(name, 20, rng)
    bare = replace(arm_of(load(name)[0].robot), T_world_base=np.eye(4), T_flange_tool=np.eye(4))
    np.testing.assert_allclose(flange(constants_of(name), right, q)[1], forward(bare, q)[:, :3, 3], atol=1e-9)
