"""The directory of a run that is recorded: its name, the writer's lock on it, its manifest, its ledger, and its end.

A recording ends cleanly while there still is room for that on its disk. Closing a run puts the Parquet file of each
open chunk beside it before the chunk goes, and some lines in the ledger: `RunWriter.room_to_close` adds up the files
from what is open now. The margin is for the lines, and for what cannot be added up: what others write to the disk
between two looks half a second apart. To begin takes more than to go on, so that a disk on the edge is not filled with
runs of a second each.

A daemon runs for months, so the memory that closing a chunk took is returned, and nothing is loaded later.

A directory that a command makes is there whole or not at all: it is filled under a hidden name, and gets its own at the
end. A command that was interrupted while it wrote left half a run, which was neither a run nor free for the next try.
What is hidden is no run to any command. It is removed where the command fails or is interrupted, and also where a
signal ends it. What SIGKILL or a power cut leaves of it is removed by the next command that writes beside it: a command
that fills such a directory holds a lock on it, which the system gives up with the process.
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
"""A full chunk of a robot (200 000 rows of 13 columns, 20 MB), closed, and the margin."""


class NearlyFull(CellError):
    """The error for a disk that is nearly full, on which everything can still be written and closed."""

    def __init__(self, place: Path, free: int, needed: int) -> None:
        problem = f"disk nearly full: {free / 1e6:.1f} MB free, {needed / 1e6:.1f} MB needed"
        super().__init__(str(place), problem, "make room")


def require_room(place: Path, needed: int) -> None:
    """Raise NearlyFull if fewer bytes are free on the disk of place, OSError if this cannot be determined."""
    free = durable.free_bytes(place)
    if free < needed:
        raise NearlyFull(place, free, needed)


_M_MMAP_THRESHOLD = -3
_LARGE_BYTES = 1 << 20


def keep_large_blocks_apart() -> None:
    """Let the C library map blocks of a megabyte and more by themselves, so that each goes back as it is freed.

    glibc raises that limit to the largest block it has seen freed, some 20 MB for a chunk; from then on it keeps room
    for one in the arena of each thread that ever closed one, and the daemon grows in steps for its first hours
    (mallopt(3)). Other C libraries have no such call, and no such arenas.
    """
    if mallopt := getattr(ctypes.CDLL(None), "mallopt", None):
        mallopt(_M_MMAP_THRESHOLD, _LARGE_BYTES)


def load_all_of_arrow() -> None:
    """Have Arrow import what it imports with its first array, before stamps and rows matter.

    That is pandas, wherever it is installed: half a second of one core in the thread that drains the readers.
    """
    pa.array([0])


def give_back() -> None:
    """Return the memory that Arrow keeps for later to the system."""
    pa.default_memory_pool().release_unused()


_TIMED = re.compile(r"[0-9]{8}T[0-9]{6}[.0-9]*Z")
"""The UTC time that some names begin with; their directories are named after them alone."""
_WHO_DELETES = "find out what deletes or moves runs"


class RunRemoved(CellError):
    """The error for a run whose directory is gone while it is recorded."""

    def __init__(self, run: Path) -> None:
        super().__init__(str(run), "the directory was removed during the recording", _WHO_DELETES)


def require_files(run: Path, open_files: Mapping[Path, int]) -> None:
    """Raise RunRemoved for a run that is gone, CellError where its manifest or an open file is. Raises OSError.

    open_files: descriptor of each by its path.
    """
    if not run.is_dir():
        raise RunRemoved(run)
    vanished = [path for path, fd in open_files.items() if not durable.is_named(fd, path)]
    if not (run / MANIFEST).exists():
        vanished.append(run / MANIFEST)
    if vanished:
        raise CellError(str(vanished[0]), "has vanished during the recording", _WHO_DELETES)


def create_run_directory(runs: Path, manifest: Manifest, companions: Mapping[str, bytes]) -> tuple[Path, int, Ledger]:
    """Create a fresh directory `<UTC time>_<name>` under runs, with the files that belong beside the rig file.

    Return it with the run's lock and its ledger.

    Raises NearlyFull if there is too little room to begin, OSError if the disk refuses.
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
    """Write the files that belong beside the rig file of a run into its directory, durably. The rig file has the digest
    of each, and the manifest that of the rig file. Raises OSError."""
    for name, content in companions.items():
        durable.replace(path / name, content)


try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

_OURS = re.compile(rf"\.[0-9a-f]{{16}}{re.escape(durable.TEMPORARY)}")
"""The name of a hidden directory."""
_TRIES = 3
"""Between the making of a directory and its lock there are microseconds, in which another command may look."""
_ENDS = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]


@contextmanager
def new_directory(path: Path) -> Iterator[Path]:
    """Give a hidden directory beside `path`, which has that name once the block has ended.

    Raises FileExistsError where something has the name, and any other OSError of a disk that refuses.
    """
    _hold_free(path)
    durable.make_directories(path.parent)
    with _hidden(path.parent) as made:
        yield made
        durable.sync_directory(made)
        _hold_free(path)
        durable.rename(made, path)
        durable.sync_directory(path.parent)


@contextmanager
def files_into(directory: Path, *, over: bool = False) -> Iterator[Path]:
    """Give a hidden directory whose files are in `directory` once the block has ended: all of them, or none.

    over: they take the place of files that are there; then each is the old one or the new one, whole. Raises
    FileExistsError with the path of a file that is there otherwise, and any other OSError of a disk that refuses.
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
                    _hold_free(directory / name)
                durable.rename(made / name, directory / name)
        except BaseException:
            for name in names if not over else ():
                if not (made / name).exists():
                    with suppress(OSError):
                        durable.remove(directory / name)
            raise
        durable.sync_directory(directory)


def surely(remove: Callable[[], object]) -> None:
    """Remove what is left over, and once more where Ctrl-C comes just then."""
    try:
        remove()
    except BaseException:
        remove()
        raise


@contextmanager
def removed_at_signals(directory: str | Path, before: Callable[[], None] = lambda: None) -> Iterator[None]:
    """Signals that end this process at once remove a directory first, unless they are handled or ignored already.

    before: called first, by this process alone and not by one that was forked of it.
    """
    owner = os.getpid()

    def leave(number: int, _: object) -> None:
        # No exception does this: one that is raised within a fork is ignored, and the signal would be lost.
        if os.getpid() == owner:  # and not a process that was forked, which shares the directory
            before()
            shutil.rmtree(directory, ignore_errors=True)
        signal.signal(number, signal.SIG_DFL)
        os.kill(os.getpid(), number)

    is_main = threading.current_thread() is threading.main_thread()  # no other may handle signals
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
            fd = _lock_of(directory)
            if fd is not None:  # of a process that was killed while it filled it
                shutil.rmtree(directory, ignore_errors=True)
                os.close(fd)
    # A hidden directory that no other command removes; the lock is None where the disk has none
    for _ in range(_TRIES):
        made = parent / f".{secrets.token_hex(8)}{durable.TEMPORARY}"
        durable.make_directory(made)
        fd = _lock_of(made)
        if fd is not None and os.path.lexists(made):
            break
        if fd is not None:  # another command took it for left over, just before the lock
            os.close(fd)
    try:
        with removed_at_signals(made):
            yield made
    finally:
        surely(lambda: shutil.rmtree(made, ignore_errors=True))
        if fd is not None:
            os.close(fd)


def _lock_of(directory: Path) -> int | None:
    """Return a descriptor that locks a directory, None where another process does, or there are no locks."""
    if fcntl is None:
        return None
    try:
        fd = os.open(directory, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
    except OSError:
        return None
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(fd)
        return None
    return fd


def _hold_free(path: Path) -> None:
    if os.path.lexists(path):
        raise FileExistsError(errno.EEXIST, "exists already", str(path))
