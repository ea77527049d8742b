"""`scripts/dev nightly` ends in time, and reports tests not started and tests failed."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

from scripts.tools import nightly as program
from tests.support.durations import Durations
from tests.support.nightly import moved

ROOT = Path(__file__).parents[1]
TESTS = """
import pytest
pytestmark = pytest.mark.nightly

def test_good():
    pass

def test_bad():
    assert False

def test_elsewhere():
    pytest.skip("there is no chromium here")
"""


@pytest.mark.parametrize(
    ("ends_s", "ended", "failed"),
    [
        ("9e9", {"passed": 1, "failed": 1, "skipped": 1}, ["test_it::test_bad"]),
        ("1", {"not begun": 3}, []),
    ],
    ids=["in time", "too late"],
)
def test_tests_not_begun_in_time_are_counted(tmp_path, ends_s, ended, failed):
    (tmp_path / "test_it.py").write_text(TESTS)
    command = [sys.executable, "-m", "pytest", "-q", "-p", "tests.conftest", "-p", "no:cacheprovider", "-m", "nightly"]
    command += ["-c", ROOT / "pyproject.toml", "--rootdir", tmp_path, "--night-ends", ends_s]
    command += [f"--junitxml={tmp_path / 'report.xml'}", tmp_path / "test_it.py"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    night = program.read(tmp_path / "report.xml", 3.0)
    assert dict(night.ended) == ended, done.stdout + done.stderr
    assert night.failed == failed and not night.is_whole
    assert program.summary(night).endswith("in 3 minutes")


def test_result_page_has_date_commit_and_longest_files():
    night = program.Night({"passed": 3}, [], 61.0)
    assert night.is_whole
    took = Durations({"a::x": 30.0, "a::y": 4.0, "b::x": 50.0, "c::x": 900.0}, {}, {"a::x", "a::y", "b::x"})
    told = program.result(night, "93de2f11", [], took)
    assert "commit 93de2f11, whole: 3 passed, 0 failed, 0 skipped, 0 not begun, in 61 minutes." in told
    rows = [line for line in told.splitlines() if line.startswith("| `")]
    assert rows == ["| `b` | 50 |", "| `a` | 34 |"] and "| all 2 files | 84 |" in told
    page = program.page_with(program.PAGE.read_text(encoding="utf-8"), told)
    assert page.startswith("# Nightly tests") and page.count(told) == 1
    assert program.page_with(page, "other").count(told) == 0
    assert "1 minutes" in program.expected(took)


@pytest.mark.parametrize("entry", moved(), ids=lambda entry: entry["of"].removeprefix("tests/"))
def test_tests_moved_to_the_night_exist(entry):
    """A name that no test has would leave a slow test in each commit, and nobody would see it."""
    place = ROOT / entry["of"]
    files = sorted(place.rglob("test_*.py")) if place.is_dir() else [place]
    defined = {
        node.name for file in files for node in ast.parse(file.read_text()).body if isinstance(node, ast.FunctionDef)
    }
    assert {name.partition("[")[0] for name in entry["tests"]} <= defined
    assert entry["stays"]
