import re
from pathlib import Path

import pytest
import yaml

from daq.store import retention
from rigs.errors import CellError, FileError, RigError
from rigs.load import load
from tests.support.bench import BIN
from tests.support.changed_rigs import shipped
from tests.support.command_line import ended, errors_of, ran, separately, succeeded


@pytest.mark.parametrize(
    ("words", "option"),
    [
        ("plan ur10e-cell --minutes 30", "--minutes"),
        ("plan ur10e-cell -o out", "--output"),
        ("live --speed 2", "--speed"),
        ("program ur10e-cell --for ur --test yaw -o out --dwell-s 5", "--dwell-s"),
        ("program ur10e-cell --for ur --test yaw -o out --outputs 0,99", "--outputs"),
        ("diagnose run --tolerance-um inf", "--tolerance-um"),
        ("diagnose run --tolerance-um much", "--tolerance-um"),
        ("program ur10e-cell --for siemens --test yaw -o out", "--for"),
        ("emulate ur10e-cell --seed -5", "--seed"),
        ("import t.csv --rig ur10e-cell --test radial --direction cw -o out", "--direction"),
        ("fleet plant -o page.pdf", "page.pdf"),
    ],
)
def test_option_without_effect_or_with_an_impossible_value_is_refused(words, option):
    (line,) = errors_of(words, exit_code=2).splitlines()
    assert line.startswith("error: ") and option in line


def test_error_names_the_rig_file_and_its_part(tmp_path):
    data = shipped("paper-fanuc")
    data["tests"]["repeatability"] = {"targets": [1, 99]}
    cell = tmp_path / "cell.yaml"
    cell.write_text(yaml.safe_dump(data))
    line = f"error: {cell}, tests.repeatability: target 99"
    of_test = f"--test repeatability -o {tmp_path}/out"
    simulated, written = f"simulate {cell} {of_test}", f"program {cell} --for ur {of_test}"
    for words in (f"check {cell}", simulated, written, f"plan {cell} --tests repeatability"):
        assert errors_of(words).startswith(line)
    assert errors_of(f"correct {cell} -o {tmp_path}/out").startswith(f"error: {cell}: ")
    data["tests"]["circle"]["centre_mm"] = [9000, 0, 0]
    cell.write_text(yaml.safe_dump(data))
    assert errors_of(f"emulate {cell} -o {tmp_path}/emulated").startswith(f"error: {cell}, tests.circle: pose 1 of")


CLOSED = ["sh", "-c", 'exec "$0" "$@" <&-', BIN / "rig"]


def test_closed_standard_input_counts_as_no_terminal(tmp_path):
    done = separately(*CLOSED, "init", tmp_path / "cell.yaml")
    assert done.returncode == 2 and done.stderr.startswith("error: --robot: ")


def test_unreadable_directory_is_named(tmp_path, monkeypatch):
    (tmp_path / "lap").mkdir()

    def denied(run: Path) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(retention, "is_run", denied)  # root may read everything
    done = ran(f"runs {tmp_path}")
    assert done.stderr.startswith(f"{tmp_path / 'lap'}: ") and not done.stdout


def test_unrecoverable_run_is_reported(tmp_path):
    succeeded(f"simulate paper-fanuc --test yaw --direction cw -o {tmp_path}")
    (run,) = (path for path in tmp_path.iterdir() if path.is_dir())
    assert ran(f"recover {run}").stdout.startswith(f"{run}: nothing ")
    ledger, table = run / "ledger.jsonl", run / "table-0001.parquet"
    kept = ledger.read_bytes()
    ledger.unlink()
    assert ran(f"verify {run}").stderr.splitlines()[0].endswith(f"run `rig recover {run}`")
    assert "import" not in ran(f"verify {run}").stderr  # the table is there
    ledger.write_bytes(b"?" + kept)
    table.rename(run / "elsewhere")
    done = ran(f"recover {run}")
    assert done.returncode == 3 and "rig verify" not in done.stdout and "table" in done.stderr
    (run / "elsewhere").rename(table)
    ledger.write_bytes(kept)
    table.write_bytes(table.read_bytes()[:-9])
    assert errors_of(f"recover {run}").splitlines()[-1].startswith(f"error: {run}: ")


def test_missing_directory_is_created(tmp_path):
    succeeded(f"simulate paper-fanuc --test yaw --direction cw -o {tmp_path}")
    (run,) = (path for path in tmp_path.iterdir() if path.is_dir())
    succeeded(f"export {run} --to csv -o {tmp_path}/new/deeper/lap.csv")
    told = errors_of(f"export {run} --to csv -o {tmp_path}/new/deeper/lap.csv/x.csv")
    assert "lap.csv" in told and "--output" in told


@pytest.mark.parametrize(
    ("asked", "says"), [("--test pose", "'pose'"), ("--test radial --direction cw", "radial test")]
)
def test_impossible_simulation_is_refused(asked, says, tmp_path):
    assert says in errors_of(f"simulate ur10e-cell {asked} -o {tmp_path}/runs", exit_code=2)
    assert not (tmp_path / "runs").exists()


ROOT = Path(__file__).parents[3]
PAGE = (ROOT / "docs" / "command-line.md").read_text()
TABLE = {int(code): words for code, words in re.findall(r"^\| (\d+) \| (.+) \|$", PAGE, re.M)}


def test_a_test_that_cannot_be_driven_costs_only_its_own_part(tmp_path, capsys):
    text = load("ur10e-cell")[1]
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
    assert ended("check", "ur10e-cell") == 0
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
    assert ended("check", "ur10e-cell") == code
    assert code in TABLE


def test_ctrl_c_reports_written_files(tmp_path, monkeypatch):
    """The exit was silent, and nobody knew whether the third of five runs was there."""
    import rigs.load  # noqa: PLC0415
    from analysis.runs import written_files  # noqa: PLC0415

    simulate = ("simulate", "ur10e-cell", "--test", "radial", "--csv", "--times", "2", "-o", tmp_path)
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
    done = ran("check ur10e-cell")
    assert done.returncode == 130 and done.stderr.startswith("interrupted; nothing ")


def test_removed_command_states_what_to_use_instead():
    assert "rig certify" in errors_of("postures targets.csv --json", exit_code=2)
