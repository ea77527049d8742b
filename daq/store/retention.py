"""Retention of runs: selection of runs to delete, and the only function that deletes them.

A run may be deleted if it is complete, exported and not protected; the oldest is deleted first. All doubtful cases
remain. A deletion first renames the run to `.deleted`, so an interrupted one leaves no partial run.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from daq.store import durable
from daq.store.ledger import LEDGER
from daq.store.manifest import MANIFEST, Manifest, is_run, load_manifest
from daq.store.marks import RunMarks, load_marks
from rigs.errors import FileError
from rigs.schema.declared_tests import Retention

_DELETED = ".deleted"
_DAY_S = 86400.0


@dataclass(frozen=True)
class RunInfo:
    path: Path
    manifest: Manifest | None
    marks: RunMarks | None
    status: str
    """Exit status in the manifest, `crashed`, or `damaged` if manifest or marks are unreadable."""
    size: int
    ended_s: float
    """Unix time of the end, or of the start if the end is unknown."""

    @property
    def may_go(self) -> bool:
        if self.manifest is None or self.marks is None or self.status in ("recording", "crashed", "damaged"):
            return False
        return bool(self.marks.exports) and not self.marks.kept


@dataclass(frozen=True)
class Decision:
    """Runs to delete, in order, and the number of bytes above the limit that cannot be freed."""

    delete: tuple[RunInfo, ...]
    over: int


def survey(runs: Path, denied: Callable[[Path], object] = lambda _: None) -> Iterator[RunInfo]:
    """Readable runs of a directory in order of name. `denied` is called with each unreadable directory."""
    try:
        entries = sorted(runs.iterdir())
    except OSError as error:
        raise FileError(
            str(runs), error.strerror or str(error), "give the directory with the runs", code="file.unreadable"
        ) from None
    for path in entries:
        try:
            if path.name.startswith(".") or path.is_symlink() or not is_run(path):
                continue
            seen = look(path)
        except FileNotFoundError:  # deleted or moved meanwhile
            continue
        except PermissionError:
            denied(path)
            continue
        yield seen


def look(run: Path) -> RunInfo:
    size = 0
    for file in run.iterdir():
        with suppress(FileNotFoundError):  # files appear and disappear while a run is being recorded
            size += file.stat().st_size
    changed_s = (run / (MANIFEST if (run / MANIFEST).exists() else LEDGER)).stat().st_mtime
    try:
        manifest, marks = load_manifest(run), load_marks(run)
        ended_s = datetime.fromisoformat(manifest.ended or manifest.started).timestamp()
    except (FileError, ValueError):
        return RunInfo(run, None, None, "damaged", size, changed_s)
    status: str = manifest.exit_status
    if status == "recording" or any(run.glob("*.arrow")):
        status = "recording" if durable.may_be_locked(run) else "crashed"
    return RunInfo(run, manifest, marks, status, size, ended_s)


def decide(runs: Sequence[RunInfo], limits: Retention, now_s: float) -> Decision:
    free = sorted((info for info in runs if info.may_go), key=lambda info: info.ended_s)
    old = [info for info in free if limits.days is not None and now_s - info.ended_s > limits.days * _DAY_S]
    allowed = int(limits.gigabytes * 1e9) if limits.gigabytes is not None else 2**63
    over = sum(info.size for info in runs) - sum(info.size for info in old) - allowed
    further = []
    for info in free[len(old) :]:
        if over <= 0:
            break
        further.append(info)
        over -= info.size
    return Decision((*old, *further), max(0, over))


def delete(run: Path) -> bool:
    lock = durable.try_lock(run)
    if lock is None:
        return False
    try:
        if not look(run).may_go:
            return False
        gone = run.with_name(f".{run.name}{_DELETED}")
        run.rename(gone)
        durable.sync_directory(run.parent)
    finally:
        os.close(lock)
    shutil.rmtree(gone)
    return True


def clear(runs: Path) -> None:
    for gone in runs.glob(f".*{_DELETED}"):
        shutil.rmtree(gone, ignore_errors=True)
