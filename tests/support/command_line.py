"""Run commands in the process of the test, which has already imported the required modules.

Use a subprocess only for features of a process: signals, a terminal, resource limits, or the set of loaded modules.
"""

from __future__ import annotations

import contextlib
import io
import json
import shlex
import signal
import sys
import threading
from functools import cache
from pathlib import Path
from subprocess import CompletedProcess, run
from typing import Any

import pytest
import typer.main
from typer.core import TyperGroup

from analysis import cli
from analysis.cli.commands import app, import_command

# evaluated again for every command line
typer.main.get_params_from_function = cache(typer.main.get_params_from_function)


def all_imported() -> TyperGroup:
    """Group `rig` with every command and group as declared in its module."""
    program = typer.main.get_group(app)
    program.commands = {name: import_command(name) for name in program.commands}
    return program


def ended(*words: str | Path) -> int:
    """Run a command as a user would, and return the exit code."""
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


def _split(words: tuple[str | Path, ...]) -> tuple[str | Path, ...]:
    return tuple(shlex.split(str(words[0]))) if len(words) == 1 else words


def ran(*words: str | Path, cwd: Path | None = None, typed: str = "", **env: str) -> CompletedProcess[str]:
    """Run a command, and return exit code and output like `subprocess.run`.

    words: the words of the command, or one line as it is typed; typed: standard input; env: environment variables in
    addition to those of the tests.
    """
    words = _split(words)
    out, err = (io.TextIOWrapper(io.BytesIO(), encoding="utf-8", write_through=True) for _ in range(2))
    with (
        contextlib.chdir(cwd or Path.cwd()),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
        pytest.MonkeyPatch.context() as patched,
    ):
        patched.setattr("sys.stdin", io.StringIO(typed))
        # otherwise the usage line would begin with `python -m pytest.rig`
        patched.setattr("__main__.__package__", None)
        for name, value in env.items():
            patched.setenv(name, value)
        code = ended(*words)
    return CompletedProcess(words, code, *(pipe.buffer.getvalue().decode() for pipe in (out, err)))


def separately(*words: object, **options: Any) -> CompletedProcess[str]:
    """Run a program in a process of its own."""
    return run(list(map(str, words)), capture_output=True, text=True, check=False, **options)


def succeeded(*words: str | Path, **options: Any) -> CompletedProcess[str]:
    """Run a command as `ran` does, and require that it succeeds."""
    done = ran(*words, **options)
    assert done.returncode == 0, done.stderr
    return done


def json_of(*words: str | Path, **options: Any) -> Any:
    """The answer of a command with --json that succeeds."""
    return json.loads(succeeded(*_split(words), "--json", **options).stdout)


def errors_of(*words: str | Path, exit_code: int = 3, **options: Any) -> str:
    """What a command that ends with an exit code prints on standard error."""
    done = ran(*words, **options)
    assert done.returncode == exit_code, done.stderr
    return done.stderr


def failure_of(*words: str | Path, cwd: Path | None = None) -> tuple[int, str]:
    """Exit code and error code of a command that fails with --json and prints no result."""
    done = ran(*_split(words), "--json", cwd=cwd)
    assert done.returncode and not done.stdout, done.stdout
    error = json.loads(done.stderr.splitlines()[-1])["error"]
    assert error["exit_code"] == done.returncode and error["remedy"]
    return done.returncode, str(error["code"])
