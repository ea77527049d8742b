"""`scripts/dev nightly` ends in time, and reports tests not started and tests failed."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

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


def test_tests_moved_to_the_night_exist():
    files = {file: file.read_text() for file in (ROOT / "tests").rglob("test_*.py")}
    for entry in moved():
        texts = [text for file, text in files.items() if file.is_relative_to(ROOT / entry["of"])]
        for name in entry["tests"]:
            assert any(f"\ndef {name.partition('[')[0]}(" in text for text in texts), name
        named = re.findall(r"[\w/]*\btest_\w+", entry["stays"])
        assert entry["stays"]
        assert all(any(file.with_suffix("").as_posix().endswith(f"/{name}") for file in files) for name in named), entry
