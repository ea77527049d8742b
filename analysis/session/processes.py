"""Processes that a session starts and that end with it, however it ends: rigd, an emulated cell, an inference.

The system itself ends them where the session is killed (`PR_SET_PDEATHSIG`), so that none holds ports or locks which
the next session needs.
"""

from __future__ import annotations

import queue
import subprocess
import sys
import threading
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, Protocol

from daq import clock
from rigs.errors import CellError, FileError

_ENTRY = (
    "import ctypes, os, signal, sys; ctypes.CDLL(None).prctl(1, signal.SIGTERM); os.nice({nice}); "
    "signal.signal(signal.SIGINT, signal.SIG_IGN); from {module} import main; sys.argv[0] = {name!r}; main()"
)
"""The child asks for SIGTERM at its parent's end and leaves Ctrl-C to it. 1 is PR_SET_PDEATHSIG (linux/prctl.h)."""
_LOOK_S = 0.05
_ENDS_S = 15.0
"""The time for a child to end in order: rigd closes a run, which a slow disk may hold up."""


class Talking(Protocol):
    """A program to which lines are written, and whose lines are read."""

    name: str
    log: Path
    lines: queue.SimpleQueue[str]

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
    """A running program of ours, its output in a log, or line by line in `lines`."""

    @classmethod
    def start(
        cls, module: str, name: str, arguments: Sequence[str | Path], log: Path, *, talks: bool = False, nice: int = 0
    ) -> Child:
        """Start a program by the `main` of a module. talks: whether lines are written to it and read from it.

        Raises FileError where its log cannot be written.
        """
        entry = _ENTRY.format(module=module, name=name, nice=nice)
        try:
            log.parent.mkdir(parents=True, exist_ok=True)
            opened = log.open("ab")
        except OSError as error:
            raise FileError(str(log), error.strerror or str(error), "give another --output") from None
        process = subprocess.Popen(  # noqa: S603 - our own program
            [sys.executable, "-c", entry, *map(str, arguments)],
            stdin=subprocess.PIPE if talks else subprocess.DEVNULL,
            stdout=subprocess.PIPE if talks else opened,
            stderr=opened,
        )
        child = cls(name, log, process, opened)
        if talks:
            threading.Thread(target=child._read, args=(process.stdout,), daemon=True).start()
        return child

    def __init__(self, name: str, log: Path, process: subprocess.Popen[bytes], opened: IO[bytes]) -> None:
        self.name, self.log = name, log
        self.lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._process, self._log = process, opened

    def _read(self, output: IO[bytes]) -> None:
        with suppress(ValueError, OSError):  # closed
            for line in output:
                text = line.decode("utf-8", "replace").rstrip("\n")
                self._log.write(line)
                self._log.flush()
                self.lines.put(text)

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
        return CellError(self.name, problem, f"see {self.log}; then the same command goes on")

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


def await_line(child: Talking, beginning: str, seconds: float) -> str:
    """Return the next line of a child that begins so. Raises CellError where it ends before, or takes too long."""
    until_s = clock.now_s() + seconds
    while clock.now_s() < until_s:
        try:
            line = child.lines.get_nowait()
        except queue.Empty:
            if not child.runs:
                raise child.ended() from None
            clock.sleep(_LOOK_S)
            continue
        if line.startswith(beginning):
            return line
    raise CellError(child.name, f"was not ready after {seconds:.0f} s", f"see {child.log}")
