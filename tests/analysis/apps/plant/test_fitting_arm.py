from __future__ import annotations

import numpy as np
import pytest

from analysis.apps.plant.fitting_arm import fitting_arm
from analysis.runs.loading import Measured
from rigs.load import load
from rigs.rig import Rig
from tests.support.pose_runs import pose_run
from tests.support.refusals import refused
from tests.worlds.arms.independent_arm import cell, none, postures

RIG = load("ur10e")[0]


def _other() -> Rig:
    """A UR10e with the upper arm of a UR10, 41 mm shorter."""
    axes = list(RIG.robot.axes)
    axes[2] = axes[2].model_copy(update={"a_mm": -571.7})
    return RIG.model_copy(update={"robot": RIG.robot.model_copy(update={"axes": tuple(axes)})})


def _poses() -> Measured:
    rng = np.random.default_rng(3)
    seen = cell("ur10e", none(), rng).seen(postures("ur10e", 30, rng), rng)
    return pose_run("ur10e", seen.q, seen.xyz_mm)


@pytest.mark.parametrize("right_first", [True, False])
def test_the_arm_that_was_measured_fits_better_in_either_order(right_first):
    arms = [("right.yaml", RIG), ("wrong.yaml", _other())]
    found = fitting_arm([_poses()], arms if right_first else arms[::-1])
    assert found.better and found.better.file == "right.yaml"
    assert found.better.rms_um < 100 and found.times > 50


def test_equal_arms_are_indistinguishable():
    found = fitting_arm([_poses()], [("one.yaml", RIG), ("two.yaml", RIG)])
    assert found.better is None and found.to_dict()["better"] is None


def test_an_arm_of_other_axes_is_refused():
    robot = RIG.robot.model_copy(update={"axes": RIG.robot.axes[:5], "coupling": None})
    with refused("compare.axes"):
        fitting_arm([_poses()], [("five.yaml", RIG.model_copy(update={"robot": robot})), ("ur10e.yaml", RIG)])
