"""Tests of real time count only without interruption; otherwise they are repeated, or skipped with the reason."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.nightly import cases

ROOT = Path(__file__).parents[1]
STOPPED = """
import os, subprocess
import pytest

def stand_still():
    me = os.getpid()
    subprocess.run(["sh", "-c", f"kill -STOP {me}; sleep 0.5; kill -CONT {me}"], check=True)
"""


def _outcome(folder: Path, test: str, *options: str, **env: str) -> str:
    """What pytest prints of a test that `tests/conftest.py` watches. env: variables beside the present ones."""
    (folder / "test_it.py").write_text(STOPPED + test)
    command = [sys.executable, "-m", "pytest", "-p", "tests.conftest", "-p", "no:cacheprovider", "-c"]
    command += [ROOT / "pyproject.toml", "--rootdir", folder, folder / "test_it.py", *options]
    variables = {name: value for name, value in os.environ.items() if name != "CI"} | env
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=100, env=variables)
    return f"{done.stdout}{done.stderr}\nended with {done.returncode}"


MARKS = ("real_time", "real_time(held_up_s=0.02)")


@pytest.mark.parametrize("mark", cases(MARKS, MARKS[:1]))
def test_a_failure_after_a_stall_is_repeated(tmp_path: Path, mark: str) -> None:
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
@pytest.mark.real_time(match="quest")
def test_it():
    stand_still()
    assert 6 * 9 == 42, "the question"
""",
    )
    assert "1 skipped, 2 rerun" in said, said
    assert "test_it: each of 3 tries was held up, so nothing follows from it; the last held up for 0." in said
    assert said.count("test_it.py::test_it: tests.conftest.HeldUpError: held up for 0.") == 2, "why it was repeated"


@pytest.mark.parametrize(
    ("tests", "code", "workers"),
    cases([(3, 0, "0"), (4, 1, "0"), (3, 0, "2"), (4, 1, "2")], [(3, 0, "0"), (4, 1, "2")]),
)
def test_more_than_a_few_that_could_not_be_judged_are_a_failure_in_ci(
    tmp_path: Path, tests: int, code: int, workers: str
) -> None:
    held_up = "".join(
        f"""
@pytest.mark.real_time(held_up_s=0)
def test_{number}():
    assert False
"""
        for number in range(tests)
    )
    if workers == "0":
        said = _outcome(tmp_path, held_up)
        assert "4 tests" not in said and said.endswith("ended with 0"), "not where a person runs them"
    said = _outcome(tmp_path, held_up, "-n", workers, CI="true")
    assert f"{tests} skipped" in said and said.endswith(f"ended with {code}")
    assert ("4 tests could not be judged, more than 3: that is a failure in CI" in said) is bool(code)


@pytest.mark.parametrize(
    ("mark", "body"),
    [
        pytest.param("real_time(held_up_s=60)", "stand_still()", id="held up for less"),
        pytest.param("real_time(match='no data')", "stand_still()", id="another failure"),
        pytest.param("skipif(False, reason='')", "stand_still()", id="time does not matter"),
        pytest.param("real_time\n@pytest.mark.timeout(2)", "stand_still(); time.sleep(60)", id="it hangs"),
    ],
)
def test_a_failure_counts_at_once_that_no_stall_explains(tmp_path: Path, mark: str, body: str) -> None:
    said = _outcome(
        tmp_path,
        f"""
import time
@pytest.mark.{mark}
def test_it():
    {body}
    assert False
""",
    )
    assert "1 failed in" in said, said
