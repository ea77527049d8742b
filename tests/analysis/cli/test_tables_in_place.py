import json
from pathlib import Path

import numpy as np
import pytest

from analysis import calibrated_arm
from tests.support.command_line import ran

TARGET = np.array([20.0, -10.0, 80.0, 1.0])


@pytest.fixture
def folder(tmp_path):
    rng = np.random.default_rng(1)
    q = rng.uniform(-100, 100, (30, 6))
    seen = (calibrated_arm("ur5").forward(q).T @ TARGET)[:, [1, 0, 2]] * [1, -1, 1] + 2000
    rows = np.hstack([q, seen + rng.normal(0, 0.05, seen.shape)])
    lines = ["J1,J2,J3,J4,J5,J6,tracker_x_mm,tracker_y_mm,tracker_z_mm"]
    lines += [",".join(f"{value:.6f}" for value in row) for row in rows]
    (tmp_path / "poses.csv").write_text("\n".join(lines) + "\n")
    return tmp_path


def code_of(*words: str, cwd: Path) -> str:
    done = ran(*words, "--json", cwd=cwd)
    assert done.returncode and not done.stdout, done.stdout
    return str(json.loads(done.stderr.splitlines()[-1])["error"]["code"])


def test_table_is_analysed_with_an_arm_of_the_library(folder):
    done = ran("analyse poses.csv --arm ur5 --json", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert "poses.csv: " in done.stderr and "ur5" in done.stderr
    (run,) = json.loads(done.stdout)["runs"]
    assert run["test"] == "pose" and run["figures"]["rms_mm"]["value"] < 0.2


def test_table_without_an_arm_is_refused(folder):
    assert code_of("diagnose", "poses.csv", cwd=folder) == "table.no_arm"


@pytest.mark.parametrize("jobs", ["1", "2"])
def test_messages_name_the_table_and_not_its_temporary_run(folder, jobs):
    (folder / "again.csv").write_bytes((folder / "poses.csv").read_bytes())
    given = ("poses.csv", "again.csv", "--arm", "ur5", "--jobs", jobs)
    refused = ran("diagnose", *given, cwd=folder)
    assert "error: again.csv: " in refused.stderr and "poses.csv" in refused.stderr
    done = ran("analyse", *given, "--json", cwd=folder)
    assert [run["run"] for run in json.loads(done.stdout)["runs"]] == ["poses.csv", "again.csv"]
    assert "rig-" not in done.stdout + done.stderr


@pytest.mark.parametrize("command", ["analyse", "diagnose", "compare", "moved"])
def test_missing_table_is_refused(folder, command):
    assert code_of(command, "nofile.csv", "poses.csv", "--arm", "ur5", cwd=folder) == "file.missing"


def test_import_infers_the_test(folder):
    done = ran("import poses.csv --arm ur5 -o runs/poses", cwd=folder)
    assert done.returncode == 0 and "poses.csv: a pose table" in done.stderr
    assert ran("analyse", "runs/poses", cwd=folder).returncode == 0


def test_library_arm_counts_as_a_rig_file_without_tests(folder):
    done = ran("check", "ur5", cwd=folder)
    assert done.returncode == 0 and "ready for: tables" in done.stdout and "not possible" not in done.stdout
    done = ran("simulate ur5 --test yaw -o sim", cwd=folder)
    assert done.returncode == 3 and done.stderr.startswith("error: ur5: ")
    assert ran("export-urdf ur5 -o arm.urdf", cwd=folder).returncode == 0


@pytest.mark.parametrize("command", [("diagnose", "ur5", "poses.csv"), ("analyse", "ur5"), ("compare", "ur5")])
def test_arm_in_place_of_a_run_is_refused(folder, command):
    assert code_of(*command, cwd=folder) == "run.arm_name"
