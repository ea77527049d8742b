"""Processes that a session starts and that end with it, however it ends: rigd, an emulated cell, an inference.

The system itself ends them where the session is killed (`PR_SET_PDEATHSIG`), so that none holds ports or locks which
the next session needs.
"""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, Protocol

from rigs.errors import CellError, FileError

_ENTRY = (
    "import ctypes, os, signal, sys; ctypes.CDLL(None).prctl(1, signal.SIGTERM); os.nice({nice}); "
    "signal.signal(signal.SIGINT, signal.SIG_IGN); from {module} import main; sys.argv[0] = {name!r}; main()"
)
"""The child asks for SIGTERM at its parent's end and leaves Ctrl-C to it. 1 is PR_SET_PDEATHSIG (linux/prctl.h)."""
_ENDS_S = 15.0
"""The time for a child to end in order: rigd closes a run, which a slow disk may hold up."""


class Talking(Protocol):
    """A program to which lines are written."""

    name: str
    log: Path

    @property
    def runs(self) -> bool:
        """Whether it has not ended."""

    def type_line(self, line: str) -> None:
        """Write a line to it. Raises CellError where it has ended."""

    def ended(self) -> CellError:
        """Return the error for its end."""

    def stop(self) -> None:
        """End it."""


class Child:
    """A running program of ours, its output in a log."""

    @classmethod
    def start(
        cls,
        module: str,
        name: str,
        arguments: Sequence[str | Path],
        log: Path,
        *,
        hear: Callable[[str], None] | None = None,
        nice: int = 0,
    ) -> Child:
        """Start a program by the `main` of a module. hear: called, in a thread, with each line of a program to which
        lines are written as well.

        Raises FileError where its log cannot be written.
        """
        entry = _ENTRY.format(module=module, name=name, nice=nice)
        try:
            log.parent.mkdir(parents=True, exist_ok=True)
            opened = log.open("ab")
        except OSError as error:
            raise FileError(str(log), error.strerror or str(error), "choose a different --output") from None
        process = subprocess.Popen(  # noqa: S603 - our own program
            [sys.executable, "-c", entry, *map(str, arguments)],
            stdin=subprocess.PIPE if hear else subprocess.DEVNULL,
            stdout=subprocess.PIPE if hear else opened,
            stderr=opened,
        )
        child = cls(name, log, process, opened)
        if hear:
            threading.Thread(target=child._read, args=(process.stdout, hear), daemon=True).start()
        return child

    def __init__(self, name: str, log: Path, process: subprocess.Popen[bytes], opened: IO[bytes]) -> None:
        self.name, self.log = name, log
        self._process, self._log = process, opened

    def _read(self, output: IO[bytes], hear: Callable[[str], None]) -> None:
        with suppress(ValueError, OSError):  # closed
            for line in output:
                self._log.write(line)
                self._log.flush()
                hear(line.decode("utf-8", "replace").rstrip("\n"))

    def type_line(self, line: str) -> None:
        """Write a line to it. Raises CellError where it has ended."""
        try:
            assert self._process.stdin is not None  # noqa: S101 - of a child that talks
            self._process.stdin.write(line.encode() + b"\n")
            self._process.stdin.flush()
        except OSError:
            raise self.ended() from None

    def ended(self) -> CellError:
        """Return the error for its end, with the last that it said."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(1.0)
        last_line = ""
        with suppress(OSError):
            last_line = next(
                (line for line in reversed(self.log.read_text("utf-8", "replace").splitlines()) if line), ""
            )
        problem = f"ended by itself: {last_line.removeprefix('error: ')}" if last_line else "ended by itself"
        return CellError(self.name, problem, f"see {self.log}; then repeat the command")

    @property
    def runs(self) -> bool:
        """Whether it has not ended."""
        return self._process.poll() is None

    @property
    def exit_code(self) -> int | None:
        """Its exit code, None while it runs."""
        return self._process.poll()

    def stop(self) -> None:
        """End it, and wait until it has ended."""
        if self.runs:
            self._process.terminate()
            try:
                self._process.wait(_ENDS_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with suppress(OSError):
                    pipe.close()
        self._log.close()
