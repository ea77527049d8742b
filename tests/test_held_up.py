"""Tests of real time count only without interruption; otherwise they are repeated, or skipped with the reason."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TESTS = """
import os, subprocess, time
import pytest

TRIES = os.path.dirname(__file__) + "/tries"


def stand_still():
    me = os.getpid()
    subprocess.run(["sh", "-c", f"kill -STOP {me}; sleep 0.3; kill -CONT {me}"], check=True)


@pytest.mark.real_time
def test_repeated():
    with open(TRIES, "a") as file:
        file.write("1")
    if os.path.getsize(TRIES) == 1:
        stand_still()
        assert False


@pytest.mark.real_time(match="quest")
def test_skipped():
    stand_still()
    assert 6 * 9 == 42, "the question"


@pytest.mark.real_time(held_up_s=60)
def test_held_up_for_less():
    stand_still()
    assert False


@pytest.mark.real_time(match="no data")
def test_fails_otherwise():
    stand_still()
    assert False


def test_without_real_time():
    stand_still()
    assert False


@pytest.mark.real_time
@pytest.mark.timeout(2)
def test_hangs():
    stand_still()
    time.sleep(60)
"""


def _run(folder: Path, tests: str, **env: str) -> str:
    (folder / "test_it.py").write_text(tests)
    command = [sys.executable, "-m", "pytest", "-p", "tests.conftest", "-p", "no:cacheprovider", "-c"]
    command += [ROOT / "pyproject.toml", "--rootdir", folder, folder / "test_it.py"]
    variables = {name: value for name, value in os.environ.items() if name != "CI"} | env
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=100, env=variables)
    return f"{done.stdout}{done.stderr}\nended with {done.returncode}"


def test_failures_after_a_stall_are_repeated_or_skipped_and_others_count(tmp_path):
    said = _run(tmp_path, TESTS)
    assert "4 failed, 1 passed, 1 skipped, 3 rerun" in said, said


@pytest.mark.parametrize(("count", "code"), [(3, 0), (4, 1)])
def test_continuous_integration_fails_after_more_than_three_unjudged_tests(tmp_path, count, code):
    tests = "import pytest\n" + "".join(
        f"@pytest.mark.real_time(held_up_s=0)\ndef test_{number}():\n    assert False\n" for number in range(count)
    )
    assert _run(tmp_path, tests, CI="true").endswith(f"ended with {code}")
