"""Pages, pictures and tables generated for a browser by commands in separate processes, executed in sequence.

A long diagnosis therefore delays neither the live page nor the recorder, and a page shows exactly the output of the
command. Writing a table does not mark the run as exported, because a browser download may be lost.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import sys
import threading
from collections import OrderedDict
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from analysis.apps.session.child_processes import Child
from analysis.runs.loading import load_measured
from analysis.runs.written_files import Writer, write_csv, write_new, write_parquet, write_xlsx
from daq import clock
from daq.store.ledger import LEDGER
from daq.store.manifest import MANIFEST
from rigs.errors import CellError, FileError, RigError
from rigs.text import plain

MOST_WAITING = 8
_MOST_KEPT = 40
"""Number of cached results. A report has 2 MB."""
_LONGEST_S = 1800.0
"""Time limit. The diagnosis of a large number of runs takes minutes."""
_NICE = 10


@dataclass(frozen=True)
class OutputRequest:
    """Output of the `main` function of a module, run as a program. `{out}` in the arguments is the output directory.

    runs: input runs; a change of any run invalidates the result.
    """

    module: str
    arguments: tuple[str, ...]
    runs: tuple[Path, ...] = ()

    @property
    def key(self) -> str:
        """Key of the cache, consisting of letters and digits."""
        parts = [self.module, *self.arguments]
        for run in self.runs:
            for name in (MANIFEST, LEDGER):
                with suppress(OSError):
                    status = (run / name).stat()
                    parts.append(f"{run / name} {status.st_mtime_ns} {status.st_size}")
        return hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:32]


class OutputStore:
    """Queued, running and finished results in a temporary directory of this process."""

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        self._lock = threading.Lock()
        self._waiting: OrderedDict[str, OutputRequest] = OrderedDict()
        self._done: OrderedDict[str, str] = OrderedDict()
        """Finished keys with the error message, empty after success."""
        self._current: tuple[str, Child, float] | None = None

    def get(self, making: OutputRequest) -> Path | None:
        """Return the directory of a result; None until it is ready.

        Raises FileError once after a failure, and CellError if the queue is full.
        """
        key = making.key
        with self._lock:
            self._advance()
            if key in self._done:
                self._done.move_to_end(key)
                why = self._done[key]
                if not why:
                    return self._directory / key
                del self._done[key]
                raise FileError(making.arguments[0], why, "check the runs, or retry")
            if key not in self._waiting and (self._current is None or self._current[0] != key):
                if len(self._waiting) >= MOST_WAITING:
                    raise CellError("rig window", "other pages are being created", "retry in a minute")
                self._waiting[key] = making
                self._advance()
            return None

    def file(self, key: str, name: str) -> Path | None:
        """Return the path of a generated file; None if it is missing."""
        with self._lock:
            if self._done.get(key) != "":
                return None
            place = self._directory / key
            files = {path.relative_to(place).as_posix(): path for path in place.rglob("*") if path.is_file()}
        return files.get(name)

    def close(self) -> None:
        """Stop the running process."""
        with self._lock:
            self._waiting.clear()
            if self._current is not None:
                self._current[1].stop()
                self._current = None

    def _advance(self) -> None:
        """Collect a finished process and start the next."""
        if self._current is not None:
            key, child, began_s = self._current
            if child.runs and clock.now_s() - began_s < _LONGEST_S:
                return
            took_too_long = child.runs
            child.stop()
            self._current = None
            # Show the results of valid runs, even if other runs were refused.
            is_made = any((self._directory / key).iterdir())
            lines = child.log.read_text("utf-8", "replace").splitlines()
            error = next((line.removeprefix("error: ") for line in lines if line.startswith("error: ")), "")
            problem = "" if is_made else error or child.ended().what
            self._done[key] = f"took more than {_LONGEST_S / 60:.0f} min" if took_too_long else problem
            while len(self._done) > _MOST_KEPT:
                old, _ = self._done.popitem(last=False)
                shutil.rmtree(self._directory / old, ignore_errors=True)
        if self._waiting:
            key, making = self._waiting.popitem(last=False)
            out = self._directory / key
            shutil.rmtree(out, ignore_errors=True)
            out.mkdir(parents=True)
            arguments = [argument.replace("{out}", str(out)) for argument in making.arguments]
            log = self._directory / f"{key}.log"
            self._current = key, Child.start(making.module, "rig", arguments, log, nice=_NICE), clock.now_s()


WRITERS = {"csv": write_csv, "parquet": write_parquet, "xlsx": write_xlsx}


def main() -> None:
    """Write the table of a run (first argument) to a file (second), in the format of its suffix."""
    run, file = (Path(argument) for argument in sys.argv[1:3])
    try:
        table = load_measured(run).to_table()
        write: Writer = partial(WRITERS[file.suffix[1:]], table)
        write_new(file, write)
    except RigError as error:
        print(plain(str(error)), file=sys.stderr)
        sys.exit(error.exit_code)
