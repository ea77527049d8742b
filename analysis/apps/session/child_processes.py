"""Child processes of a session: rigd, and an emulated cell.

The operating system terminates them if the session is killed (`PR_SET_PDEATHSIG`), which frees ports and locks for the
next session.
"""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO

from rigs.errors import CellError, FileError

_ENTRY = (
    "import ctypes, os, signal, sys; ctypes.CDLL(None).prctl(1, signal.SIGTERM); os.nice({nice}); "
    "signal.signal(signal.SIGINT, signal.SIG_IGN); from {module} import main; sys.argv[0] = {name!r}; main()"
)
"""Code of a child: SIGTERM at the death of the parent (1 is PR_SET_PDEATHSIG, linux/prctl.h), and no Ctrl-C."""
_ENDS_S = 15.0
"""Time for an orderly shutdown: rigd closes a run first, and a slow disk may delay that."""


class Child:
    """A running Python program of rig with the output in a log file."""

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
        """Start the `main` function of a module.

        hear: called from a thread with each line of output; it also opens the standard input. Raises FileError if the
        log cannot be written.
        """
        entry = _ENTRY.format(module=module, name=name, nice=nice)
        try:
            log.parent.mkdir(parents=True, exist_ok=True)
            opened = log.open("ab")
        except OSError as error:
            raise FileError.of_os(log, error, "choose a different --output", code="output.not_writable") from None
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
        with suppress(ValueError, OSError):  # the pipe is closed
            for line in output:
                self._log.write(line)
                self._log.flush()
                hear(line.decode("utf-8", "replace").rstrip("\n"))

    def type_line(self, line: str) -> None:
        """Raises CellError if the program has ended."""
        try:
            assert self._process.stdin is not None  # noqa: S101 - of a child that talks
            self._process.stdin.write(line.encode() + b"\n")
            self._process.stdin.flush()
        except OSError:
            raise self.ended() from None

    def ended(self) -> CellError:
        """Error that reports the end of the program and the last line of the log."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(1.0)
        last_line = ""
        with suppress(OSError):
            last_line = next(
                (line for line in reversed(self.log.read_text("utf-8", "replace").splitlines()) if line), ""
            )
        problem = f"exited unexpectedly: {last_line.removeprefix('error: ')}" if last_line else "exited unexpectedly"
        return CellError(self.name, problem, f"see {self.log}; then repeat the command", code="process.failed")

    @property
    def runs(self) -> bool:
        return self._process.poll() is None

    def wait(self, timeout_s: float) -> bool:
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout_s)
        return not self.runs

    def stop(self) -> None:
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
