"""What the tests stand on: values that are made once for all processes, limits of processor time, tests of a night."""

from __future__ import annotations

import shutil
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import pytest

from tests.support import made_once as kept
from tests.support.cpu_limit import OverCpuLimitError, cpu_limit
from tests.support.made_once import made_once, source_hash

ROOT = Path(__file__).parents[1]
BURN = "import time\nwhile time.process_time() < 0.4: pass"


@made_once
def _doubled(number: int, calls: Path) -> list[int]:
    with calls.open("a") as file:
        file.write("called\n")
    time.sleep(0.2)  # the other process comes meanwhile
    return [number, number]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "kept"
    folder.mkdir()
    monkeypatch.setattr(kept, "_folder", lambda: folder)  # private: the folder of this tree has what tests look at
    return folder


def test_a_value_is_made_once_for_all_processes_and_again_for_other_arguments(folder: Path, tmp_path: Path) -> None:
    calls = tmp_path / "calls"
    with ProcessPoolExecutor(2, get_context("fork")) as pool:
        assert list(pool.map(_doubled, (1, 1, 1), (calls,) * 3)) == [[1, 1]] * 3
    assert _doubled(1, calls) == [1, 1] and calls.read_text() == "called\n"
    assert _doubled(2, calls) == [2, 2] and calls.read_text() == "called\n" * 2


def test_what_ends_half_way_is_made_again(folder: Path) -> None:
    tries: list[int] = []

    @made_once
    def value() -> int:
        tries.append(len(tries))
        if len(tries) == 1:
            raise KeyboardInterrupt
        return len(tries)

    with pytest.raises(KeyboardInterrupt):
        value()
    assert value() == 2 and value() == 2 and len(tries) == 2


@pytest.mark.parametrize("change", ["content", "name", "new", "lock"])
def test_a_change_of_a_source_makes_everything_again(change: str, tmp_path: Path) -> None:
    for name in ("rigs/a.py", "tests/support/b.py", "scripts/requirements.lock"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(name)
    before = source_hash(tmp_path)
    (tmp_path / "tests" / "test_c.py").touch()  # the file of a function counts where the function is asked
    assert source_hash(tmp_path) == before
    {
        "content": lambda: (tmp_path / "rigs/a.py").write_text("RIGS/A.PY"),
        "name": lambda: shutil.move(tmp_path / "rigs/a.py", tmp_path / "rigs/c.py"),
        "new": (tmp_path / "rigs/c.yaml").touch,
        "lock": lambda: (tmp_path / "scripts/requirements.lock").write_text(""),
    }[change]()
    assert source_hash(tmp_path) != before


def test_who_computes_for_long_fails_at_once_and_who_waits_does_not() -> None:
    with cpu_limit(0.1):
        time.sleep(0.3)
    with pytest.raises(OverCpuLimitError, match=r"more than 0.1 s of processor time"), cpu_limit(0.1):
        while True:
            pass
    with pytest.raises(OverCpuLimitError), cpu_limit(0.1):
        subprocess.run([sys.executable, "-c", BURN], check=True)


def test_limits_are_those_of_the_markers_and_a_night_has_its_own_tests(tmp_path: Path) -> None:
    (tmp_path / "test_it.py").write_text(
        """
import pytest
from hypothesis import given, strategies

@pytest.mark.cpu_limit(0.3)
@given(strategies.integers())
def test_a_property_that_never_ends(number):
    while True:
        pass

@pytest.mark.nightly
def test_of_a_night():
    pass
"""
    )
    said = {}
    for marks in ("", "nightly"):
        command = [sys.executable, "-m", "pytest", "-p", "tests.conftest", "-p", "no:cacheprovider", "-m", marks, "-c"]
        command += [str(ROOT / "pyproject.toml"), "--rootdir", str(tmp_path), str(tmp_path / "test_it.py")]
        said[marks] = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False).stdout
    assert "1 failed, 1 deselected" in said[""] and "took more than 0.3 s of processor time" in said[""]
    assert "1 passed, 1 deselected" in said["nightly"]
