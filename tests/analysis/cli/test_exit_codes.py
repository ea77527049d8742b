"""The one table of exit codes, in docs/command-line.md, against the code and against what commands end with."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from rigs.errors import CellError, FileError, RigError
from rigs.load import load
from tests.support.command_line import ended, ran

ROOT = Path(__file__).parents[3]
PAGE = (ROOT / "docs" / "command-line.md").read_text()
TABLE = {int(code): words for code, words in re.findall(r"^\| (\d+) \| (.+) \|$", PAGE, re.M)}
SOURCES = [
    *sorted((ROOT / "analysis" / "cli").glob("*.py")),
    *sorted((ROOT / "analysis" / "apps").glob("*/cli_*.py")),
    ROOT / "daq" / "service" / "rigd.py",
    ROOT / "rigs" / "errors.py",
]


def _codes(source: str) -> set[int]:
    """The numbers that a program is ended with: in Exit(…), sys.exit(…), ends.put(…), _End(…) and exit_code = …."""
    found: set[int] = set()
    for node in ast.walk(ast.parse(source)):
        ends = isinstance(node, ast.Call) and ast.unparse(node.func).rpartition(".")[2] in (
            "Exit",
            "exit",
            "put",
            "_End",
        )
        is_set = isinstance(node, ast.Assign) and ast.unparse(node.targets[0]).endswith("exit_code")
        if ends or is_set:
            numbers = (one.value for one in ast.walk(node) if isinstance(one, ast.Constant))
            found |= {one for one in numbers if type(one) is int}
    return found


def test_the_table_has_every_code_of_the_programs_and_no_other():
    assert set(TABLE) == {0}.union(*(_codes(path.read_text()) for path in SOURCES))
    assert sorted(TABLE) == list(TABLE)  # in order


def test_no_other_page_has_such_a_table():
    tables = [page for page in ROOT.glob("docs/**/*.md") if re.search(r"^\| 130 \|", page.read_text(), re.M)]
    assert [page.name for page in tables] == ["command-line.md"]  # 130 is the code of Ctrl-C, in every such table


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
