"""A run that lies elsewhere as a directory of this computer, for as long as it is worked on."""

from __future__ import annotations

import multiprocessing
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

from analysis.runs.batch.outcomes import Item, Value
from analysis.runs.batch.remote_path import RemotePath
from analysis.runs.batch.remote_store import entries, explained, is_read, opened
from daq.store.ledger import to_recover
from daq.store.run_directory import removed_at_signals
from rigs.errors import CellError, FileError, RigError

_PREFIX = "rig-"
_MORE_ROOM = "set TMPDIR to a directory with more room"
_place: ContextVar[str | None] = ContextVar("place", default=None)


@contextmanager
def fetched(run: Path) -> Iterator[Path]:
    """The directory of a run; of one elsewhere a copy, which is removed at the end. It is the only one of its process,
    so that a process never takes more room than its largest run.

    Errors within name the run itself. Raises RigError where it cannot be fetched.
    """
    if not isinstance(run, RemotePath):
        yield run
        return
    with _temporary_directory(_place.get()) as name:
        copy = Path(name) / "run"
        _fetch(run, copy)
        try:
            yield copy
        except RigError as error:
            kind = FileError if isinstance(error, FileError) else CellError
            raise kind(*(named(text, copy, run) for text in (error.where, error.what, error.remedy))) from None


def named(text: str, copy: Path, run: Path) -> str:
    """A text about a copy as one about the run that it was made of, for which nothing changes if it is no copy."""
    if copy == run:
        return text
    return text.replace(to_recover(copy), "run `rig recover` on a copy of it").replace(str(copy), str(run))


@contextmanager
def place_of_copies() -> Iterator[str]:
    """A directory for the copies of several processes, which outlives those that are killed. It is removed at the end,
    also where this process is ended by SIGTERM or loses its terminal. Raises CellError where it cannot be made."""
    with _temporary_directory(None) as name, removed_at_signals(name, _kill_workers):
        yield name


def fetching_into(place: str, work: Callable[[Item], Value], item: Item) -> Value:
    """The value of the work, whose copies lie in a directory that outlives this process, should it be killed."""
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
        raise CellError("TMPDIR", f"no temporary directory can be made: {error.strerror}", _MORE_ROOM) from None
    with made as name:
        yield name


def _kill_workers() -> None:
    """Kill the processes that write copies, else they would go on writing into a directory that is removed."""
    workers = [child for child in multiprocessing.active_children() if child.daemon]
    for worker in workers:
        worker.kill()
    for worker in workers:
        worker.join()


def _fetch(run: RemotePath, into: Path) -> None:
    """Copy the files of a run that are read to a new directory."""
    with explained(run):
        into.mkdir()
        store, folder = opened(run)
        files = [file for file in entries(store, folder)[0] if is_read(file.name)]
        if not files:
            raise FileError(str(run), "holds no run", "give a run, or a directory of runs")
        needed, free = sum(file.size for file in files), shutil.disk_usage(into).free
        if needed > free:
            room = f"{tempfile.gettempdir()} has room for {free / 1e6:.1f} MB"
            raise CellError(str(run), f"has {needed / 1e6:.1f} MB, and the temporary directory {room}", _MORE_ROOM)
        store.get([f"{folder}/{file.name}" for file in files], [str(into / file.name) for file in files])
        for file in files:
            if (into / file.name).stat().st_size != file.size:
                problem = f"has changed while it was read: {file.name} is not as it was listed"
                raise FileError(str(run), problem, "give this command again")
