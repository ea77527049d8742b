"""Analysis of saved runs without POSIX-only modules, as on Windows.

`tests/portable_child.py` removes these modules and functions. Features that need a cell report this in one line.
"""

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
