"""Local copies of remote runs during their processing."""

from __future__ import annotations

import multiprocessing
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

from analysis.runs.batch.outcomes import Item, Value
from analysis.runs.batch.remote_path import ImportedRun, RemotePath
from analysis.runs.batch.remote_store import entries, explained, is_read, opened
from daq.store.ledger import to_recover
from daq.store.run_directory import removed_at_signals
from rigs.errors import CellError, FileError, RigError

_PREFIX = "rig-"
_MORE_ROOM = "set TMPDIR to a directory with more space"
_place: ContextVar[str | None] = ContextVar("place", default=None)


@contextmanager
def fetched(run: Path) -> Iterator[Path]:
    """Provide the directory of a run. A remote run is copied, and the copy is removed at the end.

    A process has a single copy at a time and therefore needs space for the largest run only. Errors in the block name
    the original run or table. Raises RigError if the run cannot be fetched.
    """
    if isinstance(run, RemotePath):
        with _temporary_directory(_place.get()) as name:
            copy = Path(name) / "run"
            _fetch(run, copy)
            with _errors_name(run, copy):
                yield copy
    elif isinstance(run, ImportedRun):
        with _errors_name(run, run.run):
            yield run.run
    else:
        yield run


@contextmanager
def _errors_name(run: Path, copy: Path) -> Iterator[None]:
    try:
        yield
    except RigError as error:
        kind = FileError if isinstance(error, FileError) else CellError
        texts = (error.where, error.what, error.remedy)
        where, what, remedy = (restore_run_path(text, copy, run) for text in texts)
        raise kind(where, what, remedy, code=error.code) from None


def restore_run_path(text: str, copy: Path, run: Path) -> str:
    """Replace the path of the copy by the original run in a text."""
    if copy == run:
        return text
    return text.replace(to_recover(copy), "run `rig recover` on a copy of the run").replace(str(copy), str(run))


@contextmanager
def place_of_copies() -> Iterator[str]:
    """Provide a directory for the copies of several processes, which remains if a process dies.

    It is removed at the end, even after SIGTERM or a hang-up. Raises CellError if it cannot be created.
    """
    with _temporary_directory(None) as name, removed_at_signals(name, _kill_workers):
        yield name


def fetching_into(place: str, work: Callable[[Item], Value], item: Item) -> Value:
    """Run the work with copies in a directory that remains if this process dies."""
    before = _place.set(place)
    try:
        return work(item)
    finally:
        _place.reset(before)


@contextmanager
def _temporary_directory(within: str | None) -> Iterator[str]:
    try:
        made = tempfile.TemporaryDirectory(prefix=_PREFIX, dir=within)
    except OSError as error:
        raise CellError(
            "TMPDIR", f"a temporary directory cannot be created: {error.strerror}", _MORE_ROOM, code="disk.no_temporary"
        ) from None
    with made as name:
        yield name


def _kill_workers() -> None:
    """Kill the processes that write copies; otherwise they would continue writing to a removed directory."""
    workers = [child for child in multiprocessing.active_children() if child.daemon]
    for worker in workers:
        worker.kill()
    for worker in workers:
        worker.join()


def _fetch(run: RemotePath, into: Path) -> None:
    """Copy the required files of a run to a new directory."""
    with explained(run):
        into.mkdir()
        store, folder = opened(run)
        files = [file for file in entries(store, folder)[0] if is_read(file.name)]
        if not files:
            raise FileError(str(run), "contains no run", "give a run or a directory of runs", code="run.missing")
        needed, free = sum(file.size for file in files), shutil.disk_usage(into).free
        if needed > free:
            room = f"{tempfile.gettempdir()} has {free / 1e6:.1f} MB of free space"
            raise CellError(
                str(run), f"has {needed / 1e6:.1f} MB, but the temporary directory {room}", _MORE_ROOM, code="disk.full"
            )
        store.get([f"{folder}/{file.name}" for file in files], [str(into / file.name) for file in files])
        for file in files:
            if (into / file.name).stat().st_size != file.size:
                problem = f"has changed while being read: {file.name} differs from the listing"
                raise FileError(str(run), problem, "repeat this command", code="run.changed")
