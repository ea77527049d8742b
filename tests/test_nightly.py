"""`scripts/dev nightly` ends in time, and reports tests not started and tests failed."""

import re
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

from scripts.tools import night
from scripts.tools import nightly as program
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
    [("9e9", {"passed": 1, "failed": 1, "skipped": 1}, ["test_it::test_bad"]), ("1", {"not begun": 3}, [])],
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


PARTS = [
    night.Part("good", ("sh", "-c", "echo; echo 3 of 3 | cat; echo"), 1),
    night.Part("bad", ("sh", "-c", "echo 1 of 3; exit 4"), 1),
    night.Part("endless", ("sleep", "1000"), 0.001),
    night.Part("absent", ("false",), 1, lambda: "not here"),
    night.Part("late", ("false",), 1e6),
]


def test_night_goes_on_after_a_failure_and_shows_the_night_before(tmp_path):
    outcomes = night.spend(PARTS, tmp_path / "logs", time.monotonic() + 3600)
    assert [(one.result, one.detail) for one in outcomes] == [
        ("passed", "3 of 3"),
        ("failed", "1 of 3"),
        ("too long", "no output"),
        ("skipped", "not here"),
        ("skipped", "the night was over"),
    ]
    page = f"before\n{night.BEGIN}\n\nnothing\n\n{night.END}\nafter\n"
    first = night.page_with(page, outcomes, "a")
    assert "| good | passed | 0 |" in first and "| – | `3 of 3` |" in first
    second = night.page_with(first, [replace(outcomes[0], result="failed"), outcomes[3]], "b")
    rows = night.rows_of(second)
    assert list(rows) == [part.name for part in PARTS]
    assert rows["good"][1::2] == ["failed", f"{rows['good'][3].partition(',')[0]}, b", "`3 of 3`"]
    assert rows["good"][4] == "passed, 0" and rows["bad"] == night.rows_of(first)["bad"]
    assert second.startswith("before\n") and second.endswith("\nafter\n")


def test_what_a_part_did_is_not_replaced_by_why_it_was_skipped():
    page = night.page_with(f"{night.BEGIN}{night.END}", [night.Outcome("one", "passed", 3, "3 of 3")], "a")
    assert night.page_with(page, [night.Outcome("one", "skipped", 0, "the night was over")], "b") == page


def test_parts_of_the_night_are_programs_that_exist_and_fit_into_it():
    for part in night.PARTS:
        script, name = ROOT / part.command[0], part.command[1] if part.command[0] == "scripts/dev" else ""
        places = [ROOT / f"scripts/tools/{name}.py", ROOT / f"tests/trials/{name}.py", ROOT / f"tests/trials/{name}"]
        assert script.exists() and (not name or any(place.exists() for place in places)), part
    assert sum(part.minutes for part in night.PARTS) <= 3 * 60 + 40  # limits; the usual durations are shorter


def test_tests_moved_to_the_night_exist():
    files = {file: file.read_text() for file in (ROOT / "tests").rglob("test_*.py")}
    for entry in moved():
        texts = [text for file, text in files.items() if file.is_relative_to(ROOT / entry["of"])]
        for name in entry["tests"]:
            assert any(f"\ndef {name.partition('[')[0]}(" in text for text in texts), name
        named = re.findall(r"[\w/]*\btest_\w+", entry["stays"])
        assert entry["stays"]
        assert all(any(file.with_suffix("").as_posix().endswith(f"/{name}") for file in files) for name in named), entry
