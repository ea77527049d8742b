import numpy as np

from analysis.apps.plant.fitting_arm import fitting_arm
from analysis.runs.loading import Measured
from rigs.load import load
from tests.support.changed_rigs import with_robot
from tests.support.pose_runs import pose_run
from tests.support.refusals import refused
from tests.worlds.arms.independent_arm import cell, none, postures

RIG = load("ur10e-cell")[0]


def _poses() -> Measured:
    rng = np.random.default_rng(3)
    seen = cell("ur10e", none(), rng).seen(postures("ur10e", 30, rng), rng)
    return pose_run("ur10e", seen.q, seen.xyz_mm)


def test_equal_arms_are_indistinguishable():
    found = fitting_arm([_poses()], [("one.yaml", RIG), ("two.yaml", RIG)])
    assert found.better is None and found.to_dict()["better"] is None


def test_an_arm_of_other_axes_is_refused():
    five = with_robot(RIG, axes=RIG.robot.axes[:5], coupling=None)
    with refused("runs.not_comparable", "axes, but poses was measured on"):
        fitting_arm([_poses()], [("five.yaml", five), ("ur10e.yaml", RIG)])
