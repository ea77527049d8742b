"""A program that is interrupted while it ends: no traceback, and the exit code of what it did."""

from __future__ import annotations

import subprocess
import sys

import pytest

AT_THE_END = """
import atexit, os, signal, sys
atexit.register(lambda: os.kill(os.getpid(), signal.SIGINT))
sys.argv = {words}
from {module} import main
main()
"""


@pytest.mark.parametrize(
    ("module", "words", "code"),
    [
        ("analysis.cli", ["rig", "--version"], 0),
        ("analysis.cli", ["rig", "check", "no-such-file"], 3),
        ("daq.service.rigd", ["rigd", "no-such-file"], 3),
    ],
)
def test_ctrl_c_at_the_last_instant_changes_nothing(module: str, words: list[str], code: int) -> None:
    program = AT_THE_END.format(module=module, words=words)
    done = subprocess.run([sys.executable, "-c", program], check=False, capture_output=True, text=True)
    assert done.returncode == code and "Traceback" not in done.stderr, done.stderr
