from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import pytest
import yaml

from daq.store import retention
from rigs.load import SHIPPED
from tests.support.bench import BIN
from tests.support.command_line import ran


@pytest.mark.parametrize(
    ("words", "option"),
    [
        (("plan", "ur10e", "--minutes", "30"), "--minutes"),
        (("plan", "ur10e", "-o", "out"), "--output"),
        (("live", "--speed", "2"), "--speed"),
        (("program", "ur10e", "--for", "ur", "--test", "yaw", "-o", "out", "--dwell-s", "5"), "--dwell-s"),
        (("program", "ur10e", "--for", "ur", "--test", "yaw", "-o", "out", "--outputs", "0,99"), "--outputs"),
        (("diagnose", "run", "--tolerance-um", "inf"), "--tolerance-um"),
        (("diagnose", "run", "--tolerance-um", "much"), "--tolerance-um"),
        (("program", "ur10e", "--for", "siemens", "--test", "yaw", "-o", "out"), "--for"),
        (("emulate", "ur10e", "--seed", "-5"), "--seed"),
        (("import", "t.csv", "--rig", "ur10e", "--test", "radial", "--direction", "cw", "-o", "out"), "--direction"),
        (("fleet", "plant", "-o", "page.pdf"), "page.pdf"),
    ],
)
def test_option_without_effect_or_with_an_impossible_value_is_refused(words, option):
    done = ran(*words)
    (line,) = done.stderr.splitlines()
    assert done.returncode == 2 and line.startswith("error: ") and option in line


def test_with_json_an_error_is_one_object_with_its_code():
    done = ran("live", "--plain", "--json")
    error = json.loads(done.stderr)["error"]
    assert (done.returncode, error["code"], error["exit_code"]) == (2, "live.option", 2) and error["remedy"]


def test_directory_without_runs_cannot_be_checked(tmp_path):
    done = ran("check", tmp_path)
    assert done.returncode == 3 and done.stderr.startswith(f"error: {tmp_path}: ")


def test_error_names_the_rig_file_and_its_part(tmp_path):
    data = yaml.safe_load((SHIPPED / "paper-fanuc.yaml").read_text())
    data["tests"]["repeatability"] = {"targets": [1, 99]}
    cell = tmp_path / "cell.yaml"
    cell.write_text(yaml.safe_dump(data))
    line = f"error: {cell}, tests.repeatability: target 99"
    simulated = ("simulate", cell, "--test", "repeatability", "-o", tmp_path / "out")
    written = ("program", cell, "--for", "ur", "--test", "repeatability", "-o", tmp_path / "out")
    for words in (("check", cell), simulated, written, ("plan", cell, "--tests", "repeatability")):
        done = ran(*words)
        assert done.returncode == 3 and done.stderr.startswith(line)
    done = ran("correct", cell, "-o", tmp_path / "out")
    assert done.stderr.startswith(f"error: {cell}: ")
    data["tests"]["circle"]["centre_mm"] = [9000, 0, 0]
    cell.write_text(yaml.safe_dump(data))
    done = ran("emulate", cell, "-o", tmp_path / "emulated")
    assert done.returncode == 3 and done.stderr.startswith(f"error: {cell}, tests.circle: pose 1 of")


def test_repeatability_without_a_hemisphere_is_reported(tmp_path):
    data = yaml.safe_load((SHIPPED / "paper-fanuc.yaml").read_text())
    cell = tmp_path / "cell.yaml"
    assert "37 targets" in ran("check", "paper-fanuc").stdout
    data["tests"] = {"circle": data["tests"]["circle"], "repeatability": {"targets": [1]}}
    cell.write_text(yaml.safe_dump(data))
    assert "tests.hemisphere" in ran("check", cell).stdout


CLOSED = ["sh", "-c", 'exec "$0" "$@" <&-', BIN / "rig"]


def test_closed_standard_input_counts_as_no_terminal(tmp_path):
    done = subprocess.run([*CLOSED, "init", tmp_path / "cell.yaml"], capture_output=True, text=True, check=False)
    assert done.returncode == 2 and done.stderr.startswith("error: --robot: ")


@pytest.mark.nightly  # 3 s; another command without a keyboard stands above
def test_emulated_cell_needs_no_keyboard(tmp_path):
    with subprocess.Popen([*CLOSED, "emulate", "ur10e", "-o", tmp_path], stdout=-1, stderr=-1, text=True) as emulated:
        assert emulated.stdout and emulated.stderr
        for line in emulated.stdout:
            if "ready" in line:
                break
        emulated.terminate()
        assert "Error" not in emulated.stderr.read()
    assert emulated.returncode == 0


def test_width_of_0_is_ignored():
    assert "Examples" in ran("analyse", "--help", COLUMNS="0").stdout or "Usage" in ran("--help", COLUMNS="0").stdout
    rigd = subprocess.run([BIN / "rigd", "--help"], capture_output=True, env=os.environ | {"COLUMNS": "0"}, check=True)
    assert b"--metrics" in rigd.stdout


def test_unreadable_directory_is_named(tmp_path, monkeypatch):
    (tmp_path / "lap").mkdir()

    def denied(run: Path) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(retention, "is_run", denied)  # root may read everything
    done = ran("runs", tmp_path)
    assert done.stderr.startswith(f"{tmp_path / 'lap'}: ") and not done.stdout


def test_unrecoverable_run_is_reported(tmp_path):
    assert ran("simulate", "paper-fanuc", "--test", "yaw", "--direction", "cw", "-o", tmp_path).returncode == 0
    (run,) = (path for path in tmp_path.iterdir() if path.is_dir())
    assert ran("recover", run).stdout.startswith(f"{run}: nothing ")
    ledger, table = run / "ledger.jsonl", run / "table-0001.parquet"
    kept = ledger.read_bytes()
    ledger.unlink()
    assert ran("verify", run).stderr.splitlines()[0].endswith(f"run `rig recover {run}`")
    assert "import" not in ran("verify", run).stderr  # the table is there
    ledger.write_bytes(b"?" + kept)
    table.rename(run / "elsewhere")
    done = ran("recover", run)
    assert done.returncode == 3 and "rig verify" not in done.stdout and "table" in done.stderr
    (run / "elsewhere").rename(table)
    ledger.write_bytes(kept)
    table.write_bytes(table.read_bytes()[:-9])
    done = ran("recover", run)
    assert done.returncode == 3 and "nothing" not in done.stdout
    assert done.stderr.splitlines()[-1].startswith(f"error: {run}: ")


def test_missing_directory_is_created(tmp_path):
    assert ran("simulate", "paper-fanuc", "--test", "yaw", "--direction", "cw", "-o", tmp_path).returncode == 0
    (run,) = (path for path in tmp_path.iterdir() if path.is_dir())
    assert ran("export", run, "--to", "csv", "-o", tmp_path / "new" / "deeper" / "lap.csv").returncode == 0
    done = ran("export", run, "--to", "csv", "-o", tmp_path / "new" / "deeper" / "lap.csv" / "x.csv")
    assert done.returncode == 3 and "lap.csv: " in done.stderr and "--output" in done.stderr


def test_runs_in_a_subdirectory_are_pointed_out(tmp_path):
    assert ran("simulate", "paper-fanuc", "--test", "radial", "-o", tmp_path / "runs").returncode == 0
    done = ran("runs", tmp_path)
    assert done.stdout.endswith(f"rig runs {tmp_path / 'runs'}\n")


def test_file_in_place_of_the_output_directory_is_refused(tmp_path):
    (tmp_path / "file").write_text("mine")
    done = ran("simulate", "paper-fanuc", "--test", "radial", "-o", tmp_path / "file")
    assert done.returncode == 4 and str(tmp_path / "file") in done.stderr
