from __future__ import annotations

import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest

from analysis.cli.console import progress_of
from tests.support.command_line import ran
from tests.support.store_cases import finished

RIG = Path(sys.executable).parent / "rig"


def on_a_terminal(*words: str | Path, **environment: str) -> tuple[str, str]:
    """What a command prints to a pipe, and to a terminal that is its standard error."""
    ours, theirs = pty.openpty()
    done = subprocess.Popen(
        [RIG, *words],
        stdout=subprocess.PIPE,
        stderr=theirs,
        text=True,
        env=os.environ | {"TERM": "xterm-256color", "COLUMNS": "200"} | environment,
    )
    os.close(theirs)
    shown = b""
    try:
        while piece := os.read(ours, 1 << 16):
            shown += piece
    except OSError:  # the terminal's other end is closed
        pass
    os.close(ours)
    return done.communicate(timeout=60)[0], shown.decode()


COMMANDS = [
    ("verify", (), "verifying"),
    ("recover", (), "recovering"),
    ("export", ("--to", "mcap", "-o", "raw.mcap"), "exporting"),
    ("analyse", (), "evaluating"),
]


@pytest.mark.parametrize(("command", "options", "doing"), COMMANDS, ids=lambda part: part if str(part) == part else "")
def test_progress_is_shown_on_a_terminal_only(command, options, doing, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run = finished(tmp_path / "runs [bold]")
    results, shown = on_a_terminal(command, run, *options)
    assert doing in shown and doing not in results
    assert command == "analyse" or "runs [bold]" in shown  # a name is not markup
    for file in tmp_path.glob("raw.mcap"):
        file.unlink()
    silent = ran(command, run, *options)
    assert silent.stdout == results and doing not in silent.stderr


def test_no_color_takes_the_colours_of_progress(tmp_path):
    run = finished(tmp_path / "runs")
    assert "\x1b[3" in on_a_terminal("verify", run)[1]  # a colour of the foreground
    assert "\x1b[3" not in on_a_terminal("verify", run, NO_COLOR="1")[1]


def test_nothing_is_shown_without_a_terminal(capsys):
    with progress_of() as progress:
        progress("anything")
    assert capsys.readouterr() == ("", "")
