import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from analysis.cli import app
from analysis.cli.console import progress_of
from tests.support.command_line import ran
from tests.support.hostile_peers import hostile_journal
from tests.support.store_cases import finished

RIG = Path(sys.executable).parent / "rig"


def on_a_terminal(*words: str | Path, **environment: str) -> tuple[str, str]:
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


def test_nothing_is_shown_without_a_terminal(capsys):
    with progress_of() as progress:
        progress("anything")
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize(("setting", "has_colours"), [(None, True), ("", True), ("1", False)])
def test_messages_have_colours_unless_refused(setting, has_colours, tmp_path):
    programs = f"{hostile_journal(tmp_path, 'text')}:{os.environ['PATH']}"
    done = CliRunner().invoke(app, ["logs"], color=True, env={"NO_COLOR": setting, "PATH": programs})
    assert done.exit_code == 0 and "error" in done.stdout
    assert ("\x1b[31m" in done.stdout) == has_colours
