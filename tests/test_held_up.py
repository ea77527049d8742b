"""A test that watches real time is judged where the computer kept up, repeated where it did not, and never passed over
without a word."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
STOPPED = """
import os, subprocess
import pytest

def stand_still():
    me = os.getpid()
    subprocess.run(["sh", "-c", f"kill -STOP {me}; sleep 0.5; kill -CONT {me}"], check=True)
"""


def _outcome(folder: Path, test: str, *options: str) -> str:
    """What pytest prints of a test that `tests/conftest.py` watches."""
    (folder / "test_it.py").write_text(STOPPED + test)
    command = [sys.executable, "-m", "pytest", "-p", "tests.conftest", "-p", "no:cacheprovider", "-c"]
    command += [ROOT / "pyproject.toml", "--rootdir", folder, folder / "test_it.py", *options]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=100)
    return done.stdout + done.stderr


@pytest.mark.parametrize("mark", ["alone", "real_time", "real_time(held_up_s=0.02)"])
def test_a_failure_while_the_computer_stood_still_is_repeated(tmp_path: Path, mark: str) -> None:
    said = _outcome(
        tmp_path,
        f"""
@pytest.mark.{mark}
def test_it(tmp_path):
    (tmp_path / "new").mkdir()  # each try has a folder of its own
    tries = {str(tmp_path)!r} + "/tries"
    with open(tries, "a") as file:
        file.write("1")
    if len(open(tries).read()) == 1:
        stand_still()
        assert False
""".replace("len(open(tries).read())", "os.path.getsize(tries)"),
    )
    assert "1 passed, 1 rerun" in said, said


def test_what_was_held_up_in_every_try_is_skipped_with_the_stall_and_the_failure(tmp_path: Path) -> None:
    said = _outcome(
        tmp_path,
        """
@pytest.mark.real_time
def test_it():
    stand_still()
    assert 6 * 9 == 42, "the question"
""",
    )
    assert "1 skipped, 2 rerun" in said, said
    assert "test_it: this computer stood still for 0.5" in said
    assert "in the last of 3 tries, so nothing follows from this: the question" in said


@pytest.mark.parametrize("mark", ["real_time", "skipif(False, reason='')"])
def test_a_failure_counts_at_once_where_the_computer_kept_up_or_time_does_not_matter(tmp_path: Path, mark: str) -> None:
    still = "pass" if mark == "real_time" else "stand_still()"
    said = _outcome(
        tmp_path,
        f"""
@pytest.mark.{mark}
def test_it():
    {still}
    assert False
""",
    )
    assert "1 failed in" in said, said


def test_each_try_has_the_whole_time_limit(tmp_path: Path) -> None:
    said = _outcome(
        tmp_path,
        """
import time
@pytest.mark.real_time
@pytest.mark.timeout(2)
def test_it():
    stand_still()
    time.sleep(60)
""",
    )
    assert "1 skipped, 2 rerun" in said and "Timeout (>2.0s)" in said, said
