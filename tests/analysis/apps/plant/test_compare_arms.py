import shutil
from pathlib import Path

import numpy as np
import pytest

from rigs.load import find
from tests.support.command_line import errors_of, json_of, ran, succeeded
from tests.support.written_files import JOINTS, PLACES, write_columns
from tests.worlds.arms.independent_arm import cell, none, postures


def arm(directory: Path, name: str, effects: str = "", shipped: str = "ur10e-cell") -> Path:
    file = directory / f"{name}.yaml"
    text = find(shipped).read_text()
    text = "\n".join(f"name: {name}" if line.startswith("name:") else line for line in text.splitlines())
    file.write_text(text + effects)
    return file


def test_a_turned_first_axis_is_a_rotation_that_teaching_takes_away(tmp_path):
    one = arm(tmp_path, "old")
    other = arm(tmp_path, "new", "\neffects:\n  - {effect: joint_offset, axis: 1, offset_deg: 0.1}\n")
    seen = json_of(f"compare {one} {other}")
    assert seen["constants"][0]["zero_deg"] == pytest.approx(0.1)
    radius = [np.hypot(*pose["apart_mm"][:2]) for pose in seen["poses"]]
    assert seen["rms_mm"] == pytest.approx(np.sqrt(np.mean(np.square(radius))))
    assert seen["turned_rms_deg"] == pytest.approx(0.1, rel=1e-6)
    assert seen["rms_mm"] > 0.5
    assert seen["taught_rms_mm"] < 0.01 * seen["rms_mm"]
    assert seen["u_rms_mm"] is None
    assert len(seen["poses"]) == 200
    said = " ".join(ran(f"compare {one} {other}").stdout.split())
    assert f" {seen['rms_mm']:.3f} mm rms " in said
    assert "+0.1000" in said


def test_arm_equals_itself_and_its_play_is_shown(tmp_path):
    one = arm(tmp_path, "one", "\neffects:\n  - {effect: backlash, axis: 2, width_deg: 0.02}\n")
    same = shutil.copy(one, tmp_path / "same.yaml")
    seen = json_of(f"compare {one} {same}")
    assert seen["max_mm"] == 0
    assert seen["play_deg"] == [{"2": 0.02}, {"2": 0.02}]


def test_without_common_range_there_is_no_u(tmp_path):
    known = "found: {date: 2026-11-20, runs: [a], sd: {offset_deg: 0.01}"
    for name, driven, unknown in (("all", "[-360, 360]", 0), ("part", "[0, 1]", 200)):
        joints = ", ".join([driven] * 6)
        effect = f"{{effect: joint_offset, axis: 2, offset_deg: 0.1, {known}, joints_deg: [{joints}]}}}}"
        one = arm(tmp_path, name, f"\neffects:\n  - {effect}\n")
        seen = json_of(f"compare {one} {shutil.copy(one, tmp_path / 'same.yaml')}")
        assert len(seen["doubts"]) == bool(unknown) and (seen["u_rms_mm"] is None) == bool(unknown)
        assert all(f"{unknown} of 200 postures" in doubt for doubt in seen["doubts"])


def test_arms_of_two_models_are_refused_in_a_line(tmp_path):
    told = errors_of("compare", arm(tmp_path, "one"), arm(tmp_path, "other", shipped="paper-fanuc"))
    assert "same model" in " ".join(told.split())


def test_runs_decide_between_rig_file_and_urdf(tmp_path):
    """Two URDFs of one arm that differed by 41 mm were refused."""
    good, other, wrong = arm(tmp_path, "good"), tmp_path / "other.yaml", tmp_path / "wrong.urdf"
    other.write_text(good.read_text().replace("a_mm: -612.7", "a_mm: -571.7"))
    succeeded(f"export-urdf {other} -o {wrong}")
    rng = np.random.default_rng(2)
    seen = cell("ur10e", none(), rng).seen(postures("ur10e", 30, rng), rng)
    write_columns(tmp_path / "poses.csv", [*JOINTS, *PLACES], np.degrees(seen.q), seen.xyz_mm)
    run = tmp_path / "poses"
    succeeded(f"import {tmp_path}/poses.csv --rig {good} --test pose -o {run}")
    found = json_of(f"compare {wrong} {good} {run}")
    assert found["better"] == str(good) and found["times"] > 10
    assert "good.yamlfits:itleaves" in "".join(ran(f"compare {wrong} {good} {run}").stdout.split())
    errors_of(f"compare {wrong} {good} {run} --plot {tmp_path}/p", exit_code=2)


def test_circles_separate_two_rig_files_but_a_urdf_has_no_tool(tmp_path):
    good, wrong = arm(tmp_path, "good"), tmp_path / "wrong.yaml"
    wrong.write_text(good.read_text().replace("a_mm: -612.7", "a_mm: -610.7"))
    succeeded(f"simulate {good} --test yaw --seed 1 -o {tmp_path}/runs")
    runs = sorted((tmp_path / "runs").iterdir())
    found = json_of("compare", wrong, good, *runs)
    assert found["better"] == str(good) and found["times"] > 3
    succeeded(f"export-urdf {wrong} -o {tmp_path}/wrong.urdf")
    assert "no tool" in ran("compare", tmp_path / "wrong.urdf", good, *runs).stderr
