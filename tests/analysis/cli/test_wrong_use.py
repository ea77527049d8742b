import json
import re
import subprocess
from pathlib import Path

import pytest
import yaml
from typer.testing import CliRunner

from analysis.cli import app
from daq.store import retention
from rigs.errors import CellError, FileError, RigError
from rigs.load import SHIPPED, load
from tests.support.bench import BIN
from tests.support.command_line import ended, ran


@pytest.mark.parametrize(
    ("words", "option"),
    [
        ("plan ur10e --minutes 30", "--minutes"),
        ("plan ur10e -o out", "--output"),
        ("live --speed 2", "--speed"),
        ("program ur10e --for ur --test yaw -o out --dwell-s 5", "--dwell-s"),
        ("program ur10e --for ur --test yaw -o out --outputs 0,99", "--outputs"),
        ("diagnose run --tolerance-um inf", "--tolerance-um"),
        ("diagnose run --tolerance-um much", "--tolerance-um"),
        ("program ur10e --for siemens --test yaw -o out", "--for"),
        ("emulate ur10e --seed -5", "--seed"),
        ("import t.csv --rig ur10e --test radial --direction cw -o out", "--direction"),
        ("fleet plant -o page.pdf", "page.pdf"),
    ],
)
def test_option_without_effect_or_with_an_impossible_value_is_refused(words, option):
    done = ran(*words.split())
    (line,) = done.stderr.splitlines()
    assert done.returncode == 2 and line.startswith("error: ") and option in line


def test_with_json_an_error_is_one_object_with_its_code():
    done = ran("live --plain --json")
    error = json.loads(done.stderr)["error"]
    assert (done.returncode, error["code"], error["exit_code"]) == (2, "live.option", 2) and error["remedy"]


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
    done = ran(f"correct {cell} -o {tmp_path}/out")
    assert done.stderr.startswith(f"error: {cell}: ")
    data["tests"]["circle"]["centre_mm"] = [9000, 0, 0]
    cell.write_text(yaml.safe_dump(data))
    done = ran(f"emulate {cell} -o {tmp_path}/emulated")
    assert done.returncode == 3 and done.stderr.startswith(f"error: {cell}, tests.circle: pose 1 of")


CLOSED = ["sh", "-c", 'exec "$0" "$@" <&-', BIN / "rig"]


def test_closed_standard_input_counts_as_no_terminal(tmp_path):
    done = subprocess.run([*CLOSED, "init", tmp_path / "cell.yaml"], capture_output=True, text=True, check=False)
    assert done.returncode == 2 and done.stderr.startswith("error: --robot: ")


def test_unreadable_directory_is_named(tmp_path, monkeypatch):
    (tmp_path / "lap").mkdir()

    def denied(run: Path) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(retention, "is_run", denied)  # root may read everything
    done = ran("runs", tmp_path)
    assert done.stderr.startswith(f"{tmp_path / 'lap'}: ") and not done.stdout


def test_unrecoverable_run_is_reported(tmp_path):
    assert ran(f"simulate paper-fanuc --test yaw --direction cw -o {tmp_path}").returncode == 0
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
    assert ran(f"simulate paper-fanuc --test yaw --direction cw -o {tmp_path}").returncode == 0
    (run,) = (path for path in tmp_path.iterdir() if path.is_dir())
    assert ran(f"export {run} --to csv -o {tmp_path}/new/deeper/lap.csv").returncode == 0
    done = ran(f"export {run} --to csv -o {tmp_path}/new/deeper/lap.csv/x.csv")
    assert done.returncode == 3 and "lap.csv" in done.stderr and "--output" in done.stderr


@pytest.mark.parametrize(
    ("asked", "says"), [(("--test", "pose"), "'pose'"), (("--test", "radial", "--direction", "cw"), "radial test")]
)
def test_impossible_simulation_is_refused(asked, says, tmp_path):
    result = CliRunner().invoke(app, ["simulate", "ur10e", *asked, "-o", str(tmp_path / "runs")])
    assert result.exit_code == 2 and says in " ".join(result.output.replace("│", " ").split())
    assert not (tmp_path / "runs").exists()


ROOT = Path(__file__).parents[3]
PAGE = (ROOT / "docs" / "command-line.md").read_text()
TABLE = {int(code): words for code, words in re.findall(r"^\| (\d+) \| (.+) \|$", PAGE, re.M)}


def test_a_test_that_cannot_be_driven_costs_only_its_own_part(tmp_path, capsys):
    text = load("ur10e")[1]
    hemisphere = text[text.index("  hemisphere:") :]
    far = tmp_path / "far.yaml"
    far.write_text(text.replace(hemisphere, re.sub(r"centre_mm: .*", "centre_mm: [9000, 0, 0]", hemisphere, count=1)))
    assert ended("check", far) == 3
    shown = capsys.readouterr()
    assert "far.yaml: valid, but" in shown.out
    assert "radius 70 mm: reachable" in shown.out
    assert shown.err.startswith(f"error: {far}, ") and "poses" in shown.err and shown.err.count("\n") == 1


def test_commands_end_with_documented_codes(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert ended("check", "ur10e") == 0
    assert ended("no-such-command") == 2
    assert ended("verify") == 2  # an argument is missing
    assert ended("analyse", tmp_path / "nothing") == 3
    assert ended("verify", tmp_path / "nothing") == 3
    assert ended("status", "--rig", "nobody") == 4  # no daemon


@pytest.mark.parametrize(
    ("failure", "code"),
    [
        (KeyboardInterrupt(), 130),
        (MemoryError(), 4),
        (OSError(28, "full"), 4),
        (ZeroDivisionError("0"), 3),
        (FileError("a", "b", "c"), 3),
        (CellError("a", "b", "c"), 4),
        (RigError("a", "b", "c"), 1),
    ],
    ids=lambda value: type(value).__name__,
)
def test_failures_end_with_documented_codes(failure, code, monkeypatch):
    import rigs.load  # noqa: PLC0415

    def fail(*_: object) -> None:
        raise failure

    if isinstance(failure, OSError):  # the buffer of standard output is given up after it: not that of the tests
        monkeypatch.setattr("os.dup2", lambda *_: None)
    monkeypatch.setattr(rigs.load, "load", fail)
    assert ended("check", "ur10e") == code
    assert code in TABLE


def test_ctrl_c_reports_written_files(tmp_path, monkeypatch):
    """The exit was silent, and nobody knew whether the third of five runs was there."""
    import rigs.load  # noqa: PLC0415
    from analysis.runs import written_files  # noqa: PLC0415

    simulate = ("simulate", "ur10e", "--test", "radial", "--csv", "--times", "2", "-o", tmp_path)
    with monkeypatch.context() as patched:
        write, calls = written_files.write_csv, []

        def stop_at_second(table: object, file: object) -> None:
            calls.append(table)
            if len(calls) > 1:
                raise KeyboardInterrupt
            write(table, file)

        patched.setattr(written_files, "write_csv", stop_at_second)
        done = ran(*simulate)
    (first,) = tmp_path.iterdir()
    assert (done.returncode, done.stderr.splitlines()[-1]) == (130, f"interrupted; complete: {first}")

    def fail(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(rigs.load, "load", fail)
    done = ran("check", "ur10e")
    assert done.returncode == 130 and done.stderr.startswith("interrupted; nothing ")
