import os
import shutil
import sys
from pathlib import Path

import pytest

from rigs.load import SHIPPED
from tests.support.command_line import ran, separately
from tests.support.store_cases import finished

BIN = Path(sys.executable).parent


def offered(place: Path, line: str) -> list[str]:
    words = line.split(" ")
    asking = {"_RIG_COMPLETE": "complete_bash", "COMP_WORDS": "\n".join(words), "COMP_CWORD": str(len(words) - 1)}
    done = ran(cwd=place, XDG_RUNTIME_DIR=str(place), **asking)
    assert (done.returncode, done.stderr) == (0, "")  # it would be written into the line that is being typed
    return [line for line in done.stdout.splitlines() if line]


@pytest.fixture
def place(tmp_path):
    run = finished(tmp_path / "runs")
    run.rename(run.with_name("lap-1"))
    for name in ("lap-2", "bad\x1bname"):
        shutil.copytree(run.with_name("lap-1"), run.with_name(name))
    (tmp_path / "runs" / "notes").mkdir()
    shutil.copy(SHIPPED / "ur10e-cell.yaml", tmp_path / "mine.yaml")
    (tmp_path / "rigd").mkdir()
    (tmp_path / "rigd" / "mine.sock").touch()
    return tmp_path


LAPS = ["runs/lap-1", "runs/lap-2"]


@pytest.mark.parametrize("line", ["rig analyse ", "rig verify runs/", "rig report -o a.html runs/l", "rig compare r"])
def test_runs_complete(place, line):
    assert offered(place, line) == LAPS


def test_runs_complete_as_values_of_options(place):
    assert offered(place, "rig diagnose runs/lap-1 --hold-out runs/lap-2") == ["runs/lap-2"]
    assert offered(place, "rig live --run ") == LAPS
    assert offered(place, "rig compare runs/lap-1 --against runs/lap-1 r") == LAPS
    assert offered(place, "rig verify nowhere/") == []
    assert offered(place / "runs", "rig verify ../runs/lap-2") == ["../runs/lap-2"]


def test_rig_files_complete(place):
    found = offered(place, "rig check ")
    assert found[0] == "mine.yaml" and {"ur10e-cell", "paper-fanuc"} <= set(found)
    assert "mine.yaml" in offered(place, "rig simulate ")
    assert offered(place, "rig calibrate runs/lap-1 --rig mi") == ["mine.yaml"]
    assert offered(place, "rig calibrate runs/lap-1 --arm ur10e") == ["ur10e-cell", "ur10e"]


def test_robots_and_daemons_complete(place):
    assert offered(place, "rig history ") == ["cell"]  # the rig of the runs
    assert offered(place, "rig history --runs elsewhere ") == []
    assert "mine" in offered(place, "rig status --rig ")


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash")
def test_bash_completes_once_it_is_installed(place):
    at_home = os.environ | {"HOME": str(place), "PATH": f"{BIN}:{os.environ['PATH']}"}

    def bash(script: str) -> str:
        return separately("bash", "--norc", "-c", script, cwd=place, env=at_home).stdout

    assert "completion installed" in bash("rig --install-completion; true")
    assert (place / ".bashrc").exists()
    asked = "source ~/.bashrc; COMP_WORDS=(rig verify runs/lap); COMP_CWORD=2; "
    called = "_rig_completion rig; printf '%s\\n' \"${COMPREPLY[@]}\"; complete -p rig"
    *found, registered = bash(asked + called).splitlines()
    assert found == LAPS and "-o default" in registered  # file names complete where nothing is offered
