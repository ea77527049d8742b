from itertools import pairwise

import numpy as np
import pytest

from analysis.apps.planning.pose_pool import axes_in_turn, is_way_clear
from analysis.procedures.pose import evaluate
from analysis.robot.kinematics.arm import arm_of
from analysis.runs.tables import PoseTable
from rigs.arms import load_arm
from rigs.load import parse
from tests.worlds.arms.one_axis import ARMS, driven, true_curve


def test_plays_and_curves_by_direction_are_those_of_the_arm():
    rig, truth, table = driven("abb-irb-1600", ARMS.index("abb-irb-1600"))
    result = evaluate(table, arm_of(rig.robot), 0.02)
    assert [curve.axis for curve in result.axes] == [1, 2, 3, 4, 5, 6]
    off_u = []
    for curve in result.axes:
        play = result.figures[f"axis{curve.axis}_reversal_deg"]
        off_u.append((play.value - np.degrees(truth.play[curve.axis - 1])) / play.u)
        up, down, off, u = true_curve(truth, table, curve)
        assert np.sqrt(np.mean((off / u) ** 2)) < 1.7
        assert result.figures[f"axis{curve.axis}_bidirectional_deg"].value == pytest.approx(
            np.nanmax([up, down]) - np.nanmin([up, down]),
            abs=4 * result.figures[f"axis{curve.axis}_bidirectional_deg"].u,
        )
    assert np.abs(off_u).max() < 3 and np.sqrt(np.mean(np.square(off_u))) < 1.6


def test_no_curve_without_the_approach_of_the_joints():
    rig, _, table = driven("abb-irb-1600", 1)
    result = evaluate(PoseTable(table.q, table.xyz_mm, None), arm_of(rig.robot), 0.02)
    assert not result.axes and not any("reversal" in name for name in result.figures)


def test_each_axis_is_planned_both_ways_and_every_way_is_clear():
    arm = arm_of(parse(f"name: x\n{load_arm('ur10e').text}", "x").robot)
    q = axes_in_turn(arm, 100, None, np.random.default_rng(0))
    moved = np.abs(np.diff(q, axis=0)) > 1e-9
    assert (moved.sum(axis=1) <= 1).all() and 80 <= len(q) <= 100
    for joint in range(6):
        ways = np.sign(np.diff(q[:, joint])[moved[:, joint]])
        assert (ways > 0).sum() >= 6 and (ways < 0).sum() >= 6
    assert all(is_way_clear(arm, begin, end) for begin, end in pairwise(q))
