"""Poses whose joints were read before they came to rest are reported as an error of the measurement; a play is not."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from analysis.apps.report.act_words import ActWords
from analysis.apps.report.summary_words import summarise
from analysis.cli import app
from analysis.diagnosis.judge.result import Diagnosis
from analysis.robot.kinematics.arm import arm_of, forward
from analysis.runs.tables import PoseTable
from rigs.arms import load_arm
from rigs.load import load, parse
from rigs.schema.effect import name_of
from tests.support.diagnosis_cells import Array, found_in, measured
from tests.worlds.arms.independent_arm import bad_zeros, cell, postures
from tests.worlds.arms.seven_axes import draw_truth, pose_table, run_of

RIG = load("ur10e")[0].model_copy(update={"effects": ()})
RNG = np.random.default_rng(61)
Q = np.radians([0, -80, 100, -20, 80, 0]) + np.radians(RNG.uniform(-1, 1, (100, 6)) * [60, 25, 25, 60, 40, 80])
XYZ = forward(arm_of(RIG.robot), Q)[:, :3, 3] + [100.0, -40.0, 10.0] + RNG.normal(0.0, 0.03, (100, 3))
CAME = np.diff(Q, axis=0, prepend=Q[:1])


def _ahead(reported: Array) -> Diagnosis:
    table = PoseTable(reported, XYZ, None, came_from=reported - CAME)
    return found_in([measured(table, "pose", "pose", RIG)], RIG)


def _reported(found: Diagnosis) -> dict[int, float]:
    said = [doubt for doubt in found.doubts if "before the joints came to rest" in doubt]
    return {int(axis): float(size) for axis, size in re.findall(r"axis (\d) by ([\d.]+)", said[0])} if said else {}


def test_joints_that_went_on_after_they_were_read_are_reported() -> None:
    ahead = np.radians([0.0, 0.02, 0.0, 0.02, 0.0, 0.0])
    found = _ahead(Q - ahead * np.sign(CAME))
    reported = _reported(found)
    assert set(reported) == {2, 4} and reported[2] == pytest.approx(0.02, abs=0.003)
    act = found.next_act
    assert act is not None and (act.kind, act.why) == ("wait", "early")
    assert "settle longer" in ActWords(found).next


def test_an_arm_whose_joints_were_read_early_is_not_called_sound() -> None:
    found = _ahead(Q - np.radians([0.03, 0.05, 0.04, 0.03, 0.05, 0.03]) * np.sign(CAME))
    assert set(_reported(found)) >= {1, 2, 3}
    assert found.condition == "not_testable_here" and found.budget == ()
    assert found.effects == () and summarise(found).standing == "not_testable_here"


def test_joints_that_had_a_share_of_their_move_to_go_are_reported() -> None:
    reported = _reported(_ahead(Q - np.array([0.0, 0.001, 0.0, 0.0, 0.0, 0.0]) * CAME))
    assert set(reported) == {2} and reported[2] == pytest.approx(0.1, abs=0.02)


def test_few_poses_with_large_errors_do_not_tell() -> None:
    """As many terms as readings follow anything, the direction of travel too."""
    rng = np.random.default_rng(5)
    place = cell("ur10e", bad_zeros(rng), rng)
    seen = place.seen(postures("ur10e", 24, rng), rng)
    table = PoseTable(np.radians(np.degrees(seen.q).round(9)), seen.xyz_mm.round(9), None)
    found = found_in([measured(table, "pose", "pose", RIG)], RIG)
    assert _reported(found) == {} and found.condition != "not_testable_here"


def test_a_play_and_a_sound_measurement_are_not() -> None:
    assert _reported(_ahead(Q)) == {}
    found = _ahead(Q + np.radians([0.0, 0.03, 0.0, 0.0, 0.0, 0.0]) * np.sign(CAME))
    assert _reported(found) == {} and [name_of(one.effect) for one in found.effects if one.is_confirmed] == [
        "backlash 2"
    ]


@pytest.mark.nightly  # 5 s
def test_a_link_that_is_off_beyond_one_angle_was_not_read_early() -> None:
    """A joint comes to large angles from below: a slipped tooth goes with its way as well."""
    rig, rng = parse(f"name: cell\n{load_arm('doosan-m1013').text}", "cell.yaml"), np.random.default_rng(1)
    truth = replace(draw_truth(rig.robot, rng, ()), slip=(4, 0.1, np.radians(0.9)))
    found = found_in([run_of(rig, pose_table(rig.robot, truth, rng, np.array([10.0, -5.0, 120.0]), 60))], rig)
    assert _reported(found) == {} and found.condition != "not_testable_here"


def test_either_set_of_joints_can_be_imported(tmp_path: Path) -> None:
    early = Q - 0.001 * CAME
    names = [*(f"q{k}_deg" for k in range(1, 7)), *(f"q{k}_commanded_deg" for k in range(1, 7)), "x_mm", "y_mm", "z_mm"]
    rows = np.column_stack([np.degrees(early), np.degrees(Q), XYZ])
    np.savetxt(tmp_path / "t.csv", rows, "%.9f", ",", header=",".join(names), comments="")
    said = {}
    for joints in ("measured", "commanded"):
        run = tmp_path / joints
        words = ["import", tmp_path / "t.csv", "--rig", "ur10e", "--test", "pose", "--joints", joints, "-o", run]
        done = CliRunner().invoke(app, [*map(str, words), "--operator", "anna"])
        assert done.exit_code == 0, done.exception
        said[joints] = CliRunner().invoke(app, ["diagnose", str(run)]).stdout
    first = " ".join(said["measured"].split("Error budget")[0].split())
    assert "rig import TABLE --test pose --joints commanded" in first
    assert "before the joints" in said["measured"] and "before the joints" not in said["commanded"]
    table = pq.read_table(tmp_path / "commanded" / "table-0001.parquet")
    np.testing.assert_allclose(table["q2_deg"], np.degrees(Q[:, 1]), atol=1e-8)
    np.testing.assert_allclose(np.array(table["q2_measured_deg"], dtype=float), np.degrees(early[:, 1]), atol=1e-8)


def test_a_table_without_commanded_joints_says_what_is_missing(tmp_path: Path) -> None:
    header = [*(f"q{k}_deg" for k in range(1, 7)), "x_mm", "y_mm", "z_mm"]
    rows = np.column_stack([np.degrees(Q), XYZ])
    np.savetxt(tmp_path / "t.csv", rows, "%.9f", ",", header=",".join(header), comments="")
    words = [
        "import",
        tmp_path / "t.csv",
        "--rig",
        "ur10e",
        "--test",
        "pose",
        "--joints",
        "commanded",
        "-o",
        tmp_path / "r",
    ]
    done = CliRunner().invoke(app, list(map(str, words)))
    assert done.exit_code == 3 and "has no q1_commanded_deg" in done.stderr
