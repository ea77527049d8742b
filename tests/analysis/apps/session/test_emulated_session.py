"""A session in an emulated cell of separate processes, killed during a recording: it continues and leaves no
processes.
"""

import os
import signal
import subprocess
import time
from pathlib import Path

import pytest

from analysis.apps.session.session_state import SessionDirectory
from tests.support.bench import BIN
from tests.support.command_line import separately
from tests.support.session_cell import cell_file

_STARTS_S, _ENDS_S = 60.0, 20.0
_TRIES = 4
"""On a busy computer laps have holes, and after three such runs the session ends and asks to be called again."""


def processes_of(directory: Path) -> list[str]:
    """The command lines of processes that have to do with a directory."""
    found = []
    for file in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            line = file.read_bytes().replace(b"\0", b" ").decode(errors="replace")
        except OSError:
            continue
        if str(directory) in line and "pytest" not in line:
            found.append(line)
    return found


@pytest.mark.cpu_limit(300)
def test_a_session_that_is_killed_goes_on_and_leaves_no_process(tmp_path):
    cell, directory = cell_file(tmp_path), tmp_path / "own"
    runtime = tmp_path / "runtime"
    runtime.mkdir(mode=0o700)
    words = f"session {cell} --for kuka --aim check --minutes 1.4 -o {directory} --emulated --effects paper-fanuc"
    command = [BIN / "rig", *words.split()]
    environment = {**os.environ, "XDG_RUNTIME_DIR": str(runtime)}
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) as first:
        until_s = time.monotonic() + _STARTS_S
        while not any((directory / "runs").glob("*_p01-yaw-acw/manifest.json")):
            assert time.monotonic() < until_s and first.poll() is None
            time.sleep(0.1)
        time.sleep(2.0)
        first.send_signal(signal.SIGKILL)
    until_s = time.monotonic() + _ENDS_S
    while processes_of(directory):
        assert time.monotonic() < until_s, processes_of(directory)
        time.sleep(0.2)
    broken = next((directory / "runs").glob("*_p01-yaw-acw"))
    for _ in range(_TRIES):
        done = separately(*command, env=environment, timeout=250)
        if done.returncode == 0:
            break
    assert done.returncode == 0, done.stdout + done.stderr
    session = SessionDirectory(directory).read()
    assert session.report and (directory / session.report).exists()
    assert broken.name in session.left_alone
    assert [step.program for step in session.steps if step.run] == ["p01-yaw-acw", "p02-yaw-cw"]
    assert session.answer is not None and session.correction is None
    assert not processes_of(directory)
