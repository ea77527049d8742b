"""Options that need or exclude others, and paths of another kind: one line, and nothing is done."""

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
    ("words", "line"),
    [
        (("plan", "ur10e", "--minutes", "30"), "--minutes: is allowed only with --propose"),
        (("plan", "ur10e", "-o", "out"), "--output: is allowed only with --propose"),
        (("live", "--speed", "2"), "--speed: is allowed only with --run"),
        (
            ("program", "ur10e", "--for", "ur", "--test", "yaw", "-o", "out", "--dwell-s", "5"),
            "rig program: Invalid value for --dwell-s: the yaw program has no targets to rest at",
        ),
        (
            ("program", "ur10e", "--for", "ur", "--test", "yaw", "-o", "out", "--outputs", "0,99"),
            "--outputs: the rig file has no rule for a signal of the yaw test; add a rule to automatic.rules",
        ),
        (("diagnose", "run", "--tolerance-um", "inf"), "rig diagnose: Invalid value for '--tolerance-um'"),
        (
            ("diagnose", "run", "--tolerance-um", "much"),
            "rig diagnose: Invalid value for '--tolerance-um': it must be a valid number; see",
        ),
        (
            ("program", "ur10e", "--for", "siemens", "--test", "yaw", "-o", "out"),
            "rig program: Invalid value for '--for': 'siemens' is not a known maker of controllers; give ur,",
        ),
        (("emulate", "ur10e", "--seed", "-5"), "rig emulate: Invalid value for '--seed': it must be greater than"),
        (
            ("import", "t.csv", "--rig", "ur10e", "--test", "radial", "--direction", "cw", "-o", "out"),
            "--direction: a radial test does not have a direction; remove it",
        ),
        (("fleet", "plant", "-o", "page.pdf"), "page.pdf: is not the name of a page"),
    ],
)
def test_an_option_that_would_do_nothing_is_refused(words: tuple[str, ...], line: str) -> None:
    done = ran(*words)
    assert done.returncode == 2 and done.stderr.startswith(f"error: {line}") and len(done.stderr.splitlines()) == 1


def test_with_json_an_error_is_one_object_with_its_code() -> None:
    done = ran("live", "--plain", "--json")
    error = json.loads(done.stderr)["error"]
    assert (done.returncode, error["code"], error["exit_code"]) == (2, "usage", 2) and error["remedy"]


def test_a_directory_without_runs_is_nothing_to_check(tmp_path: Path) -> None:
    done = ran("check", tmp_path)
    assert done.returncode == 3 and f"{tmp_path}: contains no run; give the directory of a run" in done.stderr


def test_a_rig_is_named_by_its_file_and_the_part_of_it(tmp_path: Path) -> None:
    data = yaml.safe_load((SHIPPED / "paper-fanuc.yaml").read_text())
    data["tests"]["repeatability"] = {"targets": [1, 99]}
    cell = tmp_path / "cell.yaml"
    cell.write_text(yaml.safe_dump(data))
    line = f"error: {cell}, tests.repeatability: target 99 is not one of the 37 targets of the hemisphere; correct"
    simulated = ("simulate", cell, "--test", "repeatability", "-o", tmp_path / "out")
    written = ("program", cell, "--for", "ur", "--test", "repeatability", "-o", tmp_path / "out")
    for words in (("check", cell), simulated, written, ("plan", cell, "--tests", "repeatability")):
        done = ran(*words)
        assert done.returncode == 3 and done.stderr.startswith(line)
    done = ran("correct", cell, "-o", tmp_path / "out")
    assert done.stderr.startswith(f"error: {cell}: has no effects to correct")
    data["tests"]["circle"]["centre_mm"] = [9000, 0, 0]
    cell.write_text(yaml.safe_dump(data))
    done = ran("emulate", cell, "-o", tmp_path / "emulated")
    assert done.returncode == 3 and done.stderr.startswith(f"error: {cell}, tests.circle: pose 1 of")


def test_a_repeatability_test_without_a_hemisphere_is_reported(tmp_path: Path) -> None:
    data = yaml.safe_load((SHIPPED / "paper-fanuc.yaml").read_text())
    cell = tmp_path / "cell.yaml"
    assert "37 targets in 3 orientations, all reachable" in ran("check", "paper-fanuc").stdout
    data["tests"] = {"circle": data["tests"]["circle"], "repeatability": {"targets": [1]}}
    cell.write_text(yaml.safe_dump(data))
    assert "repeatability: needs tests.hemisphere" in ran("check", cell).stdout


CLOSED = ["sh", "-c", 'exec "$0" "$@" <&-', BIN / "rig"]


def test_nobody_types_where_standard_input_is_closed(tmp_path: Path) -> None:
    done = subprocess.run([*CLOSED, "init", tmp_path / "cell.yaml"], capture_output=True, text=True, check=False)
    assert done.returncode == 2 and done.stderr.startswith(
        "error: --robot: is missing, and rig cannot ask without a terminal"
    )


@pytest.mark.nightly  # 3 s; another command without a keyboard stands above
def test_an_emulated_cell_needs_no_keyboard(tmp_path: Path) -> None:
    with subprocess.Popen([*CLOSED, "emulate", "ur10e", "-o", tmp_path], stdout=-1, stderr=-1, text=True) as emulated:
        assert emulated.stdout and emulated.stderr
        for line in emulated.stdout:
            if "ready" in line:
                break
        emulated.terminate()
        assert "Error" not in emulated.stderr.read()
    assert emulated.returncode == 0


def test_a_width_of_0_is_unknown() -> None:
    assert "Examples" in ran("analyse", "--help", COLUMNS="0").stdout or "Usage" in ran("--help", COLUMNS="0").stdout
    rigd = subprocess.run([BIN / "rigd", "--help"], capture_output=True, env=os.environ | {"COLUMNS": "0"}, check=True)
    assert b"--metrics" in rigd.stdout


def test_a_directory_that_may_not_be_read_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "lap").mkdir()

    def denied(run: Path) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(retention, "is_run", denied)  # root may read everything
    done = ran("runs", tmp_path)
    assert done.stderr == f"{tmp_path / 'lap'}: not listed: this user lacks read permission\n" and not done.stdout


def test_what_nothing_recovers_is_reported(tmp_path: Path) -> None:
    assert ran("simulate", "paper-fanuc", "--test", "yaw", "--direction", "cw", "-o", tmp_path).returncode == 0
    (run,) = (path for path in tmp_path.iterdir() if path.is_dir())
    assert ran("recover", run).stdout == f"{run}: nothing to do\n"
    ledger, table = run / "ledger.jsonl", run / "table-0001.parquet"
    kept = ledger.read_bytes()
    ledger.unlink()
    assert ran("verify", run).stderr.splitlines()[0].endswith(f"run `rig recover {run}`")
    assert "import" not in ran("verify", run).stderr, "the table is there"
    ledger.write_bytes(b"?" + kept)
    table.rename(run / "elsewhere")
    done = ran("recover", run)
    assert done.returncode == 3 and "recovered; next" not in done.stdout and "the table is not there" in done.stderr
    (run / "elsewhere").rename(table)
    ledger.write_bytes(kept)
    table.write_bytes(table.read_bytes()[:-9])
    done = ran("recover", run)
    assert done.returncode == 3 and "nothing to do" not in done.stdout
    assert done.stderr.splitlines()[-1] == (
        f"error: {run}: is still incomplete, and the rest is unrecoverable; see the lines above"
    )


def test_a_missing_directory_is_made(tmp_path: Path) -> None:
    assert ran("simulate", "paper-fanuc", "--test", "yaw", "--direction", "cw", "-o", tmp_path).returncode == 0
    (run,) = (path for path in tmp_path.iterdir() if path.is_dir())
    assert ran("export", run, "--to", "csv", "-o", tmp_path / "new" / "deeper" / "lap.csv").returncode == 0
    done = ran("export", run, "--to", "csv", "-o", tmp_path / "new" / "deeper" / "lap.csv" / "x.csv")
    assert (
        done.returncode == 3
        and "lap.csv: is a file, but a directory is needed; choose a different --output" in done.stderr
    )


def test_runs_below_are_pointed_out(tmp_path: Path) -> None:
    assert ran("simulate", "paper-fanuc", "--test", "radial", "-o", tmp_path / "runs").returncode == 0
    done = ran("runs", tmp_path)
    assert done.stdout == f"{tmp_path} does not contain runs; {tmp_path / 'runs'} does: rig runs {tmp_path / 'runs'}\n"


def test_a_simulation_that_has_no_directory_is_not_for_want_of_room(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    done = ran("simulate", "paper-fanuc", "--test", "radial", "-o", tmp_path / "file")
    assert "cannot be written: Not a directory; choose a different directory" in done.stderr
