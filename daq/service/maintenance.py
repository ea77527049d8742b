"""Slow background work in a separate thread: the metrics file, and the retention of runs."""

from __future__ import annotations

import contextlib
import logging
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from daq import clock
from daq.store.retention import RunInfo, clear, decide, delete, survey
from rigs.errors import CellError, FileError
from rigs.schema.declared_tests import Retention

log = logging.getLogger("rigd")
_METRICS_S = 10.0
_RETENTION_S = 600.0
_WARN_AGAIN_S = 3600.0
_PAUSE_S = 0.002
"""Pause between two runs. Reading a thousand manifests at once would delay the readers of this process."""
_FIRST = b"# HELP rig_"
"""First bytes of a metrics file written by rigd."""


class Maintenance(clock.StoppableThread):
    """Writes the metrics every ten seconds, and applies the retention every ten minutes, until stopped."""

    def __init__(self, metrics: Path | None, text: Callable[[], str], retention: RunRetention | None) -> None:
        super().__init__("keep house")
        self._metrics, self._text, self._retention = metrics, text, retention
        self._warned = False

    def start(self) -> None:
        if self._metrics is not None:
            try:
                if os.path.lexists(self._metrics) and not _is_own(self._metrics):
                    problem = "exists already and is not a metrics file of rigd"
                    remedy = "choose a different --metrics, or remove it first"
                    raise CellError(str(self._metrics), problem, remedy, code="output.exists")
                write_atomically(self._metrics, self._text())
            except OSError as error:
                problem, remedy = f"cannot be written: {error.strerror or error}", "choose a different --metrics"
                raise CellError(str(self._metrics), problem, remedy, code="output.not_writable") from None
        super().start()

    def run(self) -> None:
        due_s = clock.now_s()
        while not self._stop_asked.is_set():
            if self._retention is not None and clock.now_s() >= due_s:
                self._retention.apply()
                due_s = clock.now_s() + _RETENTION_S
            if self._metrics is not None:
                self._write_metrics(self._metrics)
            self._stop_asked.wait(_METRICS_S)
        if self._metrics is not None:
            with contextlib.suppress(OSError):
                if _is_own(self._metrics):
                    self._metrics.unlink(missing_ok=True)  # the content is obsolete

    def _write_metrics(self, path: Path) -> None:
        try:
            write_atomically(path, self._text())
            self._warned = False
        except OSError as error:
            if not self._warned:
                log.warning("metrics: %s cannot be written: %s", path, error.strerror or error)
            self._warned = True


def _is_own(path: Path) -> bool:
    """True if a file may be overwritten: it was written by rigd, or is empty."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(len(_FIRST)) in (b"", _FIRST)


def write_atomically(path: Path, text: str) -> None:
    """Write a file atomically, without a sync: metrics of a stopped daemon need not survive a power cut."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        temporary.write_text(text, encoding="utf-8", errors="replace")  # a path may contain bytes outside UTF-8
        temporary.replace(path)
    except OSError:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise


class RunRetention:
    def __init__(self, runs: Path, rig_name: str, limits: Retention) -> None:
        self._runs, self._rig_name, self._limits = runs, rig_name, limits
        self._warned_at = -_WARN_AGAIN_S
        self.deleted = 0
        self.deleted_bytes = 0
        self.over_bytes = 0
        self.runs = 0
        self.runs_bytes = 0

    def apply(self) -> None:
        runs = list[RunInfo]()
        try:
            for run in survey(self._runs) if self._runs.exists() else ():
                clock.sleep(_PAUSE_S)
                if run.manifest is None or run.manifest.rig_name == self._rig_name:
                    runs.append(run)
        except (OSError, FileError) as error:
            log.warning("retention: %s", error)
            return
        clear(self._runs)
        decision = decide(runs, self._limits, clock.wall_ns() / 1e9)
        while decision.delete:
            gone = {run.path for run in decision.delete if self._delete(run)}
            stuck = {run.path for run in decision.delete} - gone
            # If a run cannot be deleted, the next oldest run is tried.
            runs = [replace(run, marks=None) if run.path in stuck else run for run in runs if run.path not in gone]
            decision = decide(runs, self._limits, clock.wall_ns() / 1e9)
        self.over_bytes, self.runs, self.runs_bytes = decision.over, len(runs), sum(run.size for run in runs)
        if not self.over_bytes or clock.now_s() - self._warned_at < _WARN_AGAIN_S:
            return
        self._warned_at = clock.now_s()
        remedy = "export some runs (rig export), or release protected runs (rig keep --not)"
        message = "retention: %.2f GB more than allowed in %s, and no run can be deleted; %s"
        log.warning(message, self.over_bytes / 1e9, self._runs, remedy)

    def state(self) -> dict[str, int]:
        return {
            "runs": self.runs,
            "bytes": self.runs_bytes,
            "deleted": self.deleted,
            "deleted_bytes": self.deleted_bytes,
            "over_bytes": self.over_bytes,
        }

    def _delete(self, run: RunInfo) -> bool:
        try:
            if not delete(run.path):
                return False
        except OSError as error:
            log.warning("retention: %s cannot be deleted: %s", run.path, error.strerror or error)
            return False
        self.deleted += 1
        self.deleted_bytes += run.size
        days = (clock.wall_ns() / 1e9 - run.ended_s) / 86400
        copy = run.marks.exports[-1].file if run.marks else "?"
        log.info("retention: deleted %s, %.0f days old, %.1f MB, exported to %s", run.path, days, run.size / 1e6, copy)
        return True
