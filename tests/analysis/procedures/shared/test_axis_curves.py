import json
from itertools import pairwise

import numpy as np
import pytest

from analysis.apps.planning.pose_pool import axes_in_turn, is_way_clear
from analysis.diagnosis.diagnose import diagnose
from analysis.procedures.pose import evaluate
from analysis.robot.kinematics.arm import arm_of
from analysis.runs.tables import PoseTable
from rigs.arms import load_arm
from rigs.effects import Backlash
from rigs.load import parse
from tests.support.command_line import ran
from tests.support.nightly import cases
from tests.worlds.arms.one_axis import ARMS, driven, true_curve
from tests.worlds.arms.seven_axes import run_of


@pytest.mark.parametrize("name", cases(ARMS, ("abb-irb-1600",)))
def test_plays_and_curves_by_direction_are_those_of_the_arm(name):
    rig, truth, table = driven(name, ARMS.index(name))
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


@pytest.mark.nightly  # a play by the side from which joints came is named of touches in each commit
def test_diagnosis_names_the_play_by_the_side_of_arrival():
    rig, truth, table = driven("abb-irb-1600", ARMS.index("abb-irb-1600"))
    found = diagnose(rig, [run_of(rig, table, "sweeps", "cell")], [], [], lambda _: None)
    play = next(named for named in found.standing if isinstance(named.effect, Backlash))
    hidden = int(np.argmax(truth.play))
    assert play.effect.axis == hidden + 1
    assert abs(play.effect.width_deg - np.degrees(truth.play[hidden])) < 2 * play.sd["width_deg"]


def test_without_from_where_joints_came_there_is_no_curve():
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


def test_table_of_single_axes_is_imported_and_analysed(tmp_path):
    _, truth, table = driven("abb-irb-1600", 1)
    (tmp_path / "cell.yaml").write_text(f"name: x\n{load_arm('abb-irb-1600').text}")
    names = [*(f"q{k}_deg" for k in range(1, 7)), *(f"q{k}_from_deg" for k in range(1, 7)), "x_mm", "y_mm", "z_mm"]
    rows = np.hstack([np.degrees(table.q), np.degrees(table.came_from), table.xyz_mm])
    np.savetxt(tmp_path / "axes.csv", rows, delimiter=",", header=",".join(names), comments="", fmt="%.6f")
    done = ran("import", "axes.csv", "--rig", "cell.yaml", "--test", "pose", "-o", "axes", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    (run,) = json.loads(ran("analyse", "axes", "--json", cwd=tmp_path).stdout)["runs"]
    play = run["figures"]["axis3_reversal_deg"]
    assert abs(play["value"] - np.degrees(truth.play[2])) < 3 * play["u"]
    assert [axis["axis"] for axis in run["axes"]] == [1, 2, 3, 4, 5, 6]
    assert len(run["axes"][0]["up_deg"]) == len(run["axes"][0]["angle_deg"])
    assert "axis 3, reversal (play)" in ran("analyse", "axes", cwd=tmp_path).stdout
