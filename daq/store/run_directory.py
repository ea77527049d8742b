"""Directory of a run being recorded: name, lock, manifest, ledger, and disk space.

A directory created by a command is either complete or absent: it is filled under a hidden name, locked, and renamed at
the end. A failed or interrupted command removes the hidden directory, also after signals. Remains after SIGKILL or a
power cut are removed by the next command in the same place.
"""

from __future__ import annotations

import ctypes
import errno
import os
import re
import secrets
import shutil
import signal
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path

import pyarrow as pa

from daq import clock
from daq.store import durable
from daq.store.ledger import Ledger
from daq.store.manifest import MANIFEST, Manifest
from rigs.errors import CellError

MARGIN_BYTES = 16 << 20
TO_BEGIN_BYTES = 64 << 20
"""Bytes required to start: a full robot chunk (200 000 rows of 13 columns, 20 MB), the closed copy, and a margin."""


class NearlyFull(CellError):
    """The disk is nearly full, but all data can still be written and closed."""

    def __init__(self, place: Path, free: int, needed: int) -> None:
        problem = f"disk nearly full: {free / 1e6:.1f} MB free, {needed / 1e6:.1f} MB needed"
        super().__init__(str(place), problem, "make room", code="disk.full")


def require_room(place: Path, needed: int) -> None:
    free = durable.free_bytes(place)
    if free < needed:
        raise NearlyFull(place, free, needed)


_M_MMAP_THRESHOLD = -3
_LARGE_BYTES = 1 << 20


def keep_large_blocks_apart() -> None:
    """Make the C library map blocks of a megabyte and more separately, so that freed ones are returned.

    glibc would reserve about 20 MB in the arena of each thread that has closed a chunk (mallopt(3)).
    """
    if mallopt := getattr(ctypes.CDLL(None), "mallopt", None):
        mallopt(_M_MMAP_THRESHOLD, _LARGE_BYTES)


def load_all_of_arrow() -> None:
    """Make Arrow import pandas now, if installed, instead of half a second in the thread that drains the readers."""
    pa.array([0])


def give_back() -> None:
    pa.default_memory_pool().release_unused()


_TIMED = re.compile(r"[0-9]{8}T[0-9]{6}[.0-9]*Z")
"""UTC time at the start of a run name, which becomes the name of the directory unchanged."""
_WHO_DELETES = "find the program that deletes or moves runs"


class RunRemoved(CellError):
    def __init__(self, run: Path) -> None:
        super().__init__(str(run), "the directory was removed during the recording", _WHO_DELETES)


def require_files(run: Path, open_files: Mapping[Path, int]) -> None:
    """Raise RunRemoved if the run directory is gone, and CellError if the manifest or an open file is.

    open_files: descriptors by path.
    """
    if not run.is_dir():
        raise RunRemoved(run)
    vanished = [path for path, fd in open_files.items() if not durable.is_named(fd, path)]
    if not (run / MANIFEST).exists():
        vanished.append(run / MANIFEST)
    if vanished:
        raise CellError(str(vanished[0]), "disappeared during the recording", _WHO_DELETES, code="recording.failed")


def create_run_directory(runs: Path, manifest: Manifest, companions: Mapping[str, bytes]) -> tuple[Path, int, Ledger]:
    """Create `<UTC time>_<name>` under runs, with the companion files of the rig file.

    Returns the directory, the lock and the ledger.
    """
    durable.make_directories(runs)
    require_room(runs, TO_BEGIN_BYTES + sum(map(len, companions.values())))
    stem = manifest.name if _TIMED.match(manifest.name) else f"{clock.wall_time():%Y%m%dT%H%M%SZ}_{manifest.name}"
    for number in count(1):
        path = runs / (stem if number == 1 else f"{stem}.{number}")
        with suppress(FileExistsError):
            durable.make_directory(path)
            break
    try:
        lock = durable.lock(path)
        try:
            write_beside(path, companions)
            manifest.save(path)
            durable.sync_directory(runs)
            return path, lock, Ledger.create(path, manifest.opening())
        except OSError:
            durable.close(lock)
            raise
    except OSError:
        durable.discard(path)
        raise


def write_beside(path: Path, companions: Mapping[str, bytes]) -> None:
    """Write the companion files of the rig file, whose digests it contains, durably into a run directory."""
    for name, content in companions.items():
        durable.replace(path / name, content)


_OURS = re.compile(rf"\.[0-9a-f]{{16}}{re.escape(durable.TEMPORARY)}")
_TRIES = 3
"""Between creating and locking a directory, another command may interfere for some microseconds."""
_ENDS = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]


@contextmanager
def new_directory(path: Path) -> Iterator[Path]:
    """A hidden directory, which is renamed to `path` at the end of the block. Raises FileExistsError."""
    _refuse_existing(path)
    durable.make_directories(path.parent)
    with _hidden(path.parent) as made:
        yield made
        durable.sync_directory(made)
        _refuse_existing(path)
        durable.rename(made, path)
        durable.sync_directory(path.parent)


@contextmanager
def files_into(directory: Path, *, over: bool = False) -> Iterator[Path]:
    """A hidden directory, whose files are moved to `directory` at the end of the block: all or none.

    over: replace existing files; each is then completely old or completely new. Otherwise FileExistsError is raised
    with the path of an existing file.
    """
    if not os.path.lexists(directory):
        with new_directory(directory) as made:
            yield made
        return
    with _hidden(directory) as made:
        yield made
        names = sorted(file.name for file in made.iterdir())
        try:
            for name in names:
                if not over:
                    _refuse_existing(directory / name)
                durable.rename(made / name, directory / name)
        except BaseException:
            for name in names if not over else ():
                if not (made / name).exists():
                    with suppress(OSError):
                        durable.remove(directory / name)
            raise
        durable.sync_directory(directory)


@contextmanager
def removed_at_signals(directory: str | Path, before: Callable[[], None] = lambda: None) -> Iterator[None]:
    """Remove a directory before a signal ends this process. Signals already handled are not changed.

    before: function called first, in this process but not in forked ones.
    """
    owner = os.getpid()

    def leave(number: int, _: object) -> None:
        # An exception would not work: in a fork it would be ignored, and the signal lost.
        if os.getpid() == owner:  # not in a forked process, which shares the directory
            before()
            shutil.rmtree(directory, ignore_errors=True)
        signal.signal(number, signal.SIG_DFL)
        os.kill(os.getpid(), number)

    is_main = threading.current_thread() is threading.main_thread()  # only the main thread may handle signals
    numbers = [number for number in _ENDS if is_main and signal.getsignal(number) is signal.SIG_DFL]
    try:
        for number in numbers:
            signal.signal(number, leave)
        yield
    finally:
        for number in numbers:
            signal.signal(number, signal.SIG_DFL)


@contextmanager
def _hidden(parent: Path) -> Iterator[Path]:
    for directory in parent.glob(f".*{durable.TEMPORARY}"):
        if _OURS.fullmatch(directory.name) and not directory.is_symlink():
            fd = durable.lock_directory(directory)
            if fd is not None:  # left by a killed process
                shutil.rmtree(directory, ignore_errors=True)
                os.close(fd)
    # A hidden directory, protected from other commands. The lock is None if the disk does not support locks.
    for _ in range(_TRIES):
        made = parent / f".{secrets.token_hex(8)}{durable.TEMPORARY}"
        durable.make_directory(made)
        fd = durable.lock_directory(made)
        if fd is not None and os.path.lexists(made):
            break
        if fd is not None:  # removed by another command just before it was locked
            os.close(fd)
    try:
        with removed_at_signals(made):
            yield made
    finally:
        try:
            shutil.rmtree(made, ignore_errors=True)
        except BaseException:  # Ctrl-C meanwhile
            shutil.rmtree(made, ignore_errors=True)
            raise
        if fd is not None:
            os.close(fd)


def _refuse_existing(path: Path) -> None:
    if os.path.lexists(path):
        raise FileExistsError(errno.EEXIST, "exists already", str(path))
