import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from analysis.cli import app
from tests.support.hostile_peers import hostile_journal

RIG = Path(sys.executable).parent / "rig"


@pytest.mark.parametrize(("setting", "has_colours"), [(None, True), ("", True), ("1", False)])
def test_messages(setting, has_colours, tmp_path):
    programs = f"{hostile_journal(tmp_path, 'text')}:{os.environ['PATH']}"
    done = CliRunner().invoke(app, ["logs"], color=True, env={"NO_COLOR": setting, "PATH": programs})
    assert done.exit_code == 0 and "error" in done.stdout
    assert ("\x1b[31m" in done.stdout) == has_colours


@pytest.mark.parametrize(("setting", "has_colours"), [("", True), ("1", False)])
def test_help_on_a_terminal(setting, has_colours):
    ours, theirs = pty.openpty()
    environment = os.environ | {"TERM": "xterm-256color", "NO_COLOR": setting}
    subprocess.run([RIG, "verify", "--help"], stdout=theirs, check=True, env=environment)
    shown = os.read(ours, 1 << 16)
    for end in (ours, theirs):
        os.close(end)
    assert b"Usage" in shown and (b"\x1b[1;36m" in shown) == has_colours
