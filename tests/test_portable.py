"""Analysis of saved runs without POSIX-only modules, as on Windows.

`tests/portable_child.py` removes these modules and functions. Features that need a cell report this in one line.
"""

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
CHILD = Path(__file__).with_name("portable_child.py")


def _rig(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-X", "warn_default_encoding", CHILD, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
    # A text file without an encoding is UTF-8 here and something else on Windows.
    ours = [line for line in done.stderr.splitlines() if "EncodingWarning" in line and line.startswith(str(ROOT))]
    assert [line for line in ours if "site-packages" not in line] == []
    return done


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    runs = tmp_path_factory.mktemp("runs")
    writer = [sys.executable, ROOT / "tests" / "support" / "synthetic_run.py", runs, "10000"]
    done = subprocess.run(writer, capture_output=True, text=True, check=False, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    return Path(done.stdout.strip())


def test_a_recorded_run_is_verified_and_analysed_with_page_and_pictures(recorded, tmp_path):
    assert _rig("verify", recorded).stdout == f"{recorded}: whole\n"
    done = _rig("analyse", recorded, "--json", "--plot", tmp_path / "pictures")
    assert done.returncode == 0, done.stderr
    here = json.loads(done.stdout)["runs"][0]
    assert here["test"] == "yaw"
    assert {path.suffix for path in (tmp_path / "pictures").iterdir()} == {".png"}
    page = _rig("report", recorded, "--no-diagnosis", "-o", tmp_path / "page.html")
    assert page.returncode == 0, page.stderr
    assert "Verdict" in (tmp_path / "page.html").read_text(encoding="utf-8")
    on_linux = subprocess.run(
        [Path(sys.executable).parent / "rig", "analyse", recorded, "--json"], capture_output=True, text=True, check=True
    )
    assert json.loads(on_linux.stdout)["runs"][0]["figures"] == here["figures"]


def test_a_rig_file_is_checked():
    done = _rig("check", "paper-fanuc")
    assert done.returncode == 0, done.stderr
    assert "70 mm" in done.stdout


def test_simulated_runs_are_written_and_analysed(tmp_path):
    done = _rig("simulate", "paper-fanuc", "--test", "yaw", "-o", tmp_path)
    assert done.returncode == 0, done.stderr
    runs = done.stdout.split()
    assert len(runs) == 2
    assert _rig("verify", runs[0]).stdout == f"{runs[0]}: whole\n"
    assert _rig("analyse", *runs).returncode == 0


@pytest.mark.parametrize("command", [("status",), ("emulate", "paper-fanuc", "-o", "cell"), ("doctor", "paper-fanuc")])
def test_cell_commands_are_refused_in_one_line(command):
    done = _rig(*command)
    assert done.returncode != 0
    (line,) = (line for line in done.stderr.splitlines() if "Warning" not in line and not line.startswith("  "))
    assert line.startswith(f"error: rig {command[0]}: ") and "Linux" in line
