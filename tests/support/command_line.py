"""Commands as a person calls them, in the process of the test: it has imported already what they need.

A process of its own is for what only a process has: signals, a terminal, limits, modules that are not loaded.
"""

from __future__ import annotations

import contextlib
import io
import signal
import sys
import threading
from functools import cache
from pathlib import Path
from subprocess import CompletedProcess

import pytest
import typer.main

from analysis import cli

typer.main.get_params_from_function = cache(typer.main.get_params_from_function)  # asked anew for every command line


def ended(*words: str | Path) -> int:
    """What a command ends with, called as a person calls it."""
    before, interrupted = sys.argv, signal.getsignal(signal.SIGINT)
    sys.argv = ["rig", *map(str, words)]
    try:
        with pytest.raises(SystemExit) as end:
            cli.main()
    finally:
        sys.argv = before
        if threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGINT, interrupted)
    return int(end.value.code or 0)


def ran(*words: str | Path, cwd: Path | None = None, **env: str) -> CompletedProcess[str]:
    """A command with what it ends with and what it prints, as `subprocess.run` would give it; nobody types.

    env: variables that it finds beside those of the tests.
    """
    out, err = (io.TextIOWrapper(io.BytesIO(), encoding="utf-8", write_through=True) for _ in range(2))
    with (
        contextlib.chdir(cwd or Path.cwd()),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
        pytest.MonkeyPatch.context() as patched,
    ):
        patched.setattr("sys.stdin", io.StringIO())
        patched.setattr("__main__.__package__", None)  # else usage is `python -m pytest.rig`
        for name, value in env.items():
            patched.setenv(name, value)
        code = ended(*words)
    return CompletedProcess(words, code, *(pipe.buffer.getvalue().decode() for pipe in (out, err)))
