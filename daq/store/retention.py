"""How long runs are kept: which of them may go, which of these have to, and the one function that deletes.

Only a whole run that was exported and is not kept may go, oldest first. Whatever is in doubt stays: a run being
recorded, one that crashed, a manifest or marks that cannot be read, a directory that is no run. A deletion first
takes the run's name away, so that one that is cut off leaves no half run behind, but a `.deleted` directory that the
next round removes.
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
from daq.store.marks import Marks, load_marks
from rigs.errors import FileError
from rigs.schema.declared_tests import Retention

_DELETED = ".deleted"
_DAY_S = 86400.0


@dataclass(frozen=True)
class RunInfo:
    """What is known of a run from its directory. ended_s: Unix time of its end, or of its start if it has none.

    status: the manifest's exit status, or `crashed`, or `damaged` where manifest or marks cannot be read.
    """

    path: Path
    manifest: Manifest | None
    marks: Marks | None
    status: str
    size: int
    ended_s: float

    @property
    def may_go(self) -> bool:
        """Whether retention may delete it."""
        if self.manifest is None or self.marks is None or self.status in ("recording", "crashed", "damaged"):
            return False
        return bool(self.marks.exports) and not self.marks.kept


@dataclass(frozen=True)
class Decision:
    """delete: what has to go, in this order; over: bytes beyond the limit that are left, since nothing more may go."""

    delete: tuple[RunInfo, ...]
    over: int


def survey(runs: Path, denied: Callable[[Path], object] = lambda _: None) -> Iterator[RunInfo]:
    """Return every run in a directory that this user may read, in order of name, and call `denied` with each
    directory that this user may not.

    Raises FileError where there is no such directory.
    """
    try:
        entries = sorted(runs.iterdir())
    except OSError as error:
        raise FileError(str(runs), error.strerror or str(error), "give the directory that holds the runs") from None
    for path in entries:
        try:
            if path.name.startswith(".") or path.is_symlink() or not is_run(path):
                continue
            seen = look(path)
        except FileNotFoundError:  # deleted or moved away meanwhile
            continue
        except PermissionError:
            denied(path)
            continue
        yield seen


def look(run: Path) -> RunInfo:
    """Return what is known of one run from its directory. Raises FileNotFoundError if it is gone."""
    size = 0
    for file in run.iterdir():
        with suppress(FileNotFoundError):  # a run that is being recorded makes files and removes them
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
    """Decide what has to be deleted: what is too old, then the oldest until the rest fits."""
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
    """Delete a run after checking again that it may be deleted; False if it may not. Raises OSError."""
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
    """Remove what interrupted deletions have left, as far as possible."""
    for gone in runs.glob(f".*{_DELETED}"):
        shutil.rmtree(gone, ignore_errors=True)
