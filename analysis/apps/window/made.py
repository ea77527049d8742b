"""Pages and pictures made by `rig` commands in separate processes, which delay neither the live page nor the
recorder."""

from __future__ import annotations

import hashlib
import json
import shutil
import threading
from collections.abc import Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

from analysis.apps.session.child_processes import Child
from daq.store.ledger import LEDGER
from daq.store.manifest import MANIFEST
from rigs.errors import CellError, FileError

MOST_WAITING = 8
_MOST_KEPT = 40
"""Cached results. A report has 2 MB."""
_LONGEST_S = 1800.0
"""The diagnosis of a large number of runs takes minutes."""
_NICE = 10


class OutputStore:
    """Results of commands in a temporary directory, as futures of a queue with one worker."""

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        self._lock = threading.Lock()
        self._worker = ThreadPoolExecutor(1, "rig window made")
        self._made: dict[str, Future[Path]] = {}
        self._child: Child | None = None

    def get(self, words: Sequence[str], runs: Iterable[Path]) -> Path | None:
        """Directory with the output of a command; None until it is ready.

        words: command and arguments, in which `{out}` is the directory. runs: input; a change makes a new result.
        Raises the error of the command once, and CellError if the queue is full.
        """
        key = _key(words, runs)
        with self._lock:
            made = self._made.pop(key, None)
            if made is None:
                if sum(not other.done() for other in self._made.values()) > MOST_WAITING:
                    problem = "other pages are being created"
                    raise CellError("rig window", problem, "retry in a minute", code="daemon.busy")
                made = self._worker.submit(self._run, key, words)
            elif made.done() and made.exception() is not None:
                return made.result()
            self._made[key] = made  # at the end: the oldest results are removed first
            while len(self._made) > _MOST_KEPT:
                oldest = next(iter(self._made))
                self._made.pop(oldest).cancel()
                shutil.rmtree(self._directory / oldest, ignore_errors=True)
        return made.result() if made.done() else None

    def file(self, key: str, name: str) -> Path | None:
        made = self._made.get(key)
        if made is None or not made.done() or made.exception() is not None:
            return None
        files = {path.relative_to(made.result()).as_posix(): path for path in made.result().rglob("*")}
        return files.get(name)

    def close(self) -> None:
        self._worker.shutdown(wait=False, cancel_futures=True)
        if self._child is not None:
            self._child.stop()

    def _run(self, key: str, words: Sequence[str]) -> Path:
        out, log = self._directory / key, self._directory / f"{key}.log"
        shutil.rmtree(out, ignore_errors=True)
        log.unlink(missing_ok=True)
        out.mkdir(parents=True)
        arguments = [word.replace("{out}", str(out)) for word in words]
        child = self._child = Child.start("analysis.cli", "rig", arguments, log, nice=_NICE)
        is_late = not child.wait(_LONGEST_S)
        child.stop()
        if is_late or not any(out.iterdir()):  # a result of the valid runs counts, even if other runs were refused
            lines = log.read_text("utf-8", "replace").splitlines()
            error = next((line.removeprefix("error: ") for line in lines if line.startswith("error: ")), "")
            problem = f"took more than {_LONGEST_S / 60:.0f} min" if is_late else error or child.ended().what
            raise FileError(words[0], problem, "check the runs, or retry", code="process.failed")
        return out


def _key(words: Sequence[str], runs: Iterable[Path]) -> str:
    parts = list(words)
    for file in (run / name for run in runs for name in (MANIFEST, LEDGER)):
        with suppress(OSError):
            status = file.stat()
            parts.append(f"{file} {status.st_mtime_ns} {status.st_size}")
    return hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:32]
