import json

import numpy as np
import pytest

from analysis import calibrated_arm
from tests.support.command_line import errors_of, failure_of, ran, succeeded
from tests.support.written_files import write_columns

TARGET = np.array([20.0, -10.0, 80.0, 1.0])


@pytest.fixture
def folder(tmp_path):
    rng = np.random.default_rng(1)
    q = rng.uniform(-100, 100, (30, 6))
    seen = (calibrated_arm("ur5").forward(q).T @ TARGET)[:, [1, 0, 2]] * [1, -1, 1] + 2000
    names = ["J1,J2,J3,J4,J5,J6,tracker_x_mm,tracker_y_mm,tracker_z_mm"]
    write_columns(tmp_path / "poses.csv", names, q, seen + rng.normal(0, 0.05, seen.shape))
    return tmp_path


def test_table_is_analysed_with_an_arm_of_the_library(folder):
    done = succeeded("analyse poses.csv --arm ur5 --json", cwd=folder)
    assert "poses.csv: " in done.stderr and "ur5" in done.stderr
    (run,) = json.loads(done.stdout)["runs"]
    assert run["test"] == "pose" and run["figures"]["rms_mm"]["value"] < 0.2


def test_table_without_an_arm_is_refused(folder):
    assert failure_of("diagnose poses.csv", cwd=folder)[1] == "table.unclear"


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
    assert failure_of(f"{command} nofile.csv poses.csv --arm ur5", cwd=folder)[1] == "file.missing"


def test_import_infers_the_test(folder):
    done = succeeded("import poses.csv --arm ur5 -o runs/poses", cwd=folder)
    assert "poses.csv: a pose table" in done.stderr
    succeeded("analyse runs/poses", cwd=folder)


def test_library_arm_counts_as_a_rig_file_without_tests(folder):
    done = succeeded("check ur5", cwd=folder)
    assert "ready for: tables" in done.stdout and "not possible" not in done.stdout
    assert errors_of("simulate ur5 --test yaw -o sim", cwd=folder).startswith("error: ur5: ")
    succeeded("export-urdf ur5 -o arm.urdf", cwd=folder)


@pytest.mark.parametrize("command", [("diagnose", "ur5", "poses.csv"), ("analyse", "ur5"), ("compare", "ur5")])
def test_arm_in_place_of_a_run_is_refused(folder, command):
    assert failure_of(*command, cwd=folder)[1] == "usage"
