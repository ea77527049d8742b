"""Several runs in one answer: no number broken by a narrow screen, and no doubt of which run a figure is."""

import json
from pathlib import Path

import numpy as np
import pytest

from analysis import evaluate, evaluate_runs, load_run
from analysis.apps.report.blocks import Table
from analysis.apps.report.run_answer import as_object, compare, runs_answer
from analysis.procedures.pooled import pooled
from analysis.procedures.results import by_test
from analysis.robot.kinematics.arm import arm_of, forward
from rigs.load import load, load_hidden
from tests.support.answers import printed
from tests.support.changed_rigs import with_circle
from tests.support.command_line import succeeded
from tests.support.pose_runs import pose_run
from tests.support.refusals import refused
from tests.support.written_runs import write_simulated

RIG, TEXT = load("ur10e-cell")
RIG = load_hidden("ur10e-cell").apply_to(RIG)


@pytest.fixture(scope="module")
def laps(tmp_path_factory):
    folder = tmp_path_factory.mktemp("laps")
    runs = write_simulated(RIG, TEXT, "yaw", ("acw", "cw"), [1, 2], folder)
    return evaluate_runs([load_run(run) for run in runs])


@pytest.mark.parametrize(("width", "abreast"), [(80, 2), (200, 4)])
def test_as_many_runs_abreast_as_the_screen_holds_whole(laps, width, abreast):
    shown = printed([block for block in runs_answer(laps, each=True) if isinstance(block, Table)][1:], width)
    assert max(map(len, shown.splitlines())) <= width
    for name in ("band_deg", "amplitude_deg"):
        assert all(str(result.figures[name]) in shown for result in laps)
    assert max(line.count("± ") for line in shown.splitlines()) == abreast


def test_runs_of_other_poses_have_no_common_mean():
    """60 poses once and ten of them five times are two programs, however alike their tests are named."""
    rng = np.random.default_rng(1)
    q = np.radians(rng.uniform(-60, 60, (60, 6)))
    runs = []
    for name, rows in (("many", q), ("again", q), ("few", np.tile(q[:10], (5, 1)))):
        places = forward(arm_of(RIG.robot), rows)[:, :3, 3] + rng.normal(0, 0.02, (len(rows), 3))
        runs.append(pose_run("ur10e", rows, places, name))
    results = evaluate_runs(runs)
    for order in (results, results[::-1]):
        (together,) = pooled(order)
        assert {run.measured.path.name for run in together.runs} == {"many", "again"}
        ((other, why),) = together.left_out
        assert other.measured.path.name == "few" and "the poses are not those of" in why


def test_every_repeat_is_paired_and_runs_of_a_direction_become_a_mean(laps):
    table = next(block for block in runs_answer(laps) if isinstance(block, Table))
    assert len(table.columns) == 4 and all("2" in column for column in table.columns[1:])
    answer = as_object(laps)
    (both,) = answer["acw_against_cw"]
    assert [Path(run).name for run in both["runs"]] == ["yaw-acw-001", "yaw-cw-001", "yaw-acw-002", "yaw-cw-002"]
    acw = next(one for one in answer["between_runs"] if one["direction"] == "acw")
    singles = [run["figures"]["band_deg"]["value"] for run in answer["runs"] if run["direction"] == "acw"]
    band = acw["figures"]["band_deg"]
    assert band["value"] == pytest.approx(np.mean(singles)) and band["runs"] == 2
    assert band["sd_between_runs"] == pytest.approx(np.std(singles, ddof=1))
    # Student's law with one degree of freedom.
    assert band["u"] >= 0.99 * 6.98 * band["sd_between_runs"] / np.sqrt(2)


def test_runs_of_two_placements_are_not_pooled(tmp_path):
    runs = list(write_simulated(RIG, TEXT, "yaw", ("acw", "cw"), [1, 2], tmp_path))
    for run in runs[2:]:
        succeeded(f"relabel {run} --placement door")
    results = evaluate_runs([load_run(run) for run in runs])
    assert [[one.name for one in group] for group in by_test(results)] == [
        [run.name for run in runs[:2]],
        [run.name for run in runs[2:]],
    ]


def test_a_single_run_beside_repeated_ones_says_it_too(laps):
    acw = [result for result in laps if result.title == "yaw acw"]
    cw = next(result for result in laps if result.title == "yaw cw")
    (remark,) = (line for line in as_object([*acw, cw])["remarks"] if "single run: u " in line)
    assert "2 yaw acw runs" in remark and "yaw cw: single run: u " in remark
    assert not any("single run: u " in line for line in as_object(laps)["remarks"])


def test_a_run_of_another_set_up_has_no_part_in_the_mean(laps, tmp_path):
    elsewhere = with_circle(RIG, eccentricity_mm=(1.4, -0.4, 0.1))
    (path,) = write_simulated(elsewhere, TEXT, "yaw", ("acw",), [9], tmp_path)
    three = [*(result for result in laps if result.title == "yaw acw"), evaluate(load_run(path))]
    (one,) = as_object(three)["between_runs"]
    assert len(one["runs"]) == 2
    (why,) = one["left_out"].values()
    assert path.name not in one["runs"] and why


def test_truth_without_values_of_a_test_is_reported(laps, tmp_path):
    truth = tmp_path / "truth.json"
    truth.write_text(json.dumps({"rig": "ur10e", "yaw": {"acw": {"band_deg": 0.1}, "cw": {"band_deg": 0.1}}}))
    (radial,) = write_simulated(RIG, TEXT, "radial", (None,), [1], tmp_path)
    with refused("runs.not_comparable", "does not cover the radial test"):
        compare([evaluate(load_run(radial))], truth)
    assert [list(one) for one in compare([*laps[:1], evaluate(load_run(radial))], truth)] == [["band_deg"], []]
