"""Options that need or exclude others, and paths of another kind: one line, and nothing is done."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.command_line import ran


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (("plan", "ur10e", "--minutes", "30"), "--minutes: is allowed only with --propose"),
        (("plan", "ur10e", "-o", "out"), "--output: is allowed only with --propose"),
        (("calibrate", "run", "--fit", "joint_offset", "--groups"), "--groups: says how --share chooses"),
        (("live", "--speed", "2"), "--speed: is allowed only with --run"),
        (("live", "--plain", "--json"), "--plain and --json: exclude each other"),
    ],
)
def test_an_option_that_would_do_nothing_is_refused(words: tuple[str, ...], line: str) -> None:
    done = ran(*words)
    assert done.returncode == 2 and done.stderr.startswith(f"error: {line}") and len(done.stderr.splitlines()) == 1


def test_a_directory_is_no_rig_file(tmp_path: Path) -> None:
    done = ran("check", tmp_path)
    assert done.returncode == 3 and f"{tmp_path}: is a directory, and no rig file; give a file in it" in done.stderr


def test_runs_below_are_pointed_out(tmp_path: Path) -> None:
    assert ran("simulate", "paper-fanuc", "--test", "radial", "-o", tmp_path / "runs").returncode == 0
    done = ran("runs", tmp_path)
    assert done.stdout == f"{tmp_path} holds no runs; {tmp_path / 'runs'} does: rig runs {tmp_path / 'runs'}\n"


def test_a_simulation_that_has_no_directory_is_not_for_want_of_room(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    done = ran("simulate", "paper-fanuc", "--test", "radial", "-o", tmp_path / "file")
    assert "cannot be written: Not a directory; choose another directory" in done.stderr
