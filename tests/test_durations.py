"""`scripts/dev durations`: what each test took, the newest of each, and the longest first."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from scripts.tools import durations as program
from tests.support.durations import durations

ROOT = Path(__file__).parents[1]
TESTS = """
import time
import pytest

@pytest.fixture
def slow():
    burn()

def burn():
    end = time.process_time() + 0.1
    while time.process_time() < end:
        pass

def test_quick():
    pass

def test_slow(slow):
    burn()
"""


@pytest.mark.parametrize("workers", ["0", "1"])
def test_a_session_keeps_what_each_test_and_each_fixture_took(tmp_path: Path, workers: str) -> None:
    (tmp_path / "test_it.py").write_text(TESTS)
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-p",
        "tests.conftest",
        "-n",
        workers,
        "-c",
        ROOT / "pyproject.toml",
    ]
    command += ["--rootdir", tmp_path, "-o", f"cache_dir={tmp_path / 'kept'}", tmp_path / "test_it.py"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    found = durations(tmp_path / "kept" / "d" / "durations", tmp_path)
    assert set(found.tests) == {"test_it.py::test_quick", "test_it.py::test_slow"}
    slow_s = found.tests["test_it.py::test_slow"]
    assert slow_s > 0.19 and found.tests["test_it.py::test_quick"] <= slow_s - 0.19
    ((fixture, (took,)),) = found.by_fixture().items()
    assert fixture == "test_it.py::slow" and 0.09 < took <= slow_s - 0.09


def test_the_newest_of_each_test_counts_and_the_longest_comes_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    here, other = "tests/test_suite.py::test_it", "tests/test_dev.py::test_it"
    sessions = [
        {here: (9.0, {"x::it": 3.0}, False), "tests/gone.py::test_it": (80.0, {}, False)},
        {here: (2.0, {}, False)},
    ]
    sessions.append({other: (6.0, {"x::it": 1.0}, False), "tests/test_docs.py::test_it": (60.0, {}, True)})
    for number, session in enumerate(sessions):
        (tmp_path / f"{number}.json").write_text(json.dumps(session))
    monkeypatch.setattr(sys, "argv", ["durations", "--kept", str(tmp_path)])
    assert program.main() == 0
    first, *lines = [line for line in capsys.readouterr().out.splitlines() if line]
    assert first == "2 tests: 0.1 minutes of processor time"
    assert lines[1:3] == [f"    6.00 s   75.0 %  {other}", f"    2.00 s   25.0 %  {here}"]
    assert lines[-1].endswith("x::it  ×1")
    monkeypatch.setattr(sys, "argv", ["durations", "--nightly", "--kept", str(tmp_path)])
    assert program.main() == 0 and "1 tests: 1.0 minutes" in capsys.readouterr().out
    monkeypatch.setattr(sys, "argv", ["durations", "--kept", str(tmp_path / "nothing")])
    assert program.main() == 1 and "no test has run here yet" in capsys.readouterr().err
