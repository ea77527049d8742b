"""The directory of a run that is recorded: its name, the writer's lock on it, its manifest, its ledger, and its end.

How much room a recording needs on its disk, so that it ends cleanly while there still is some.

Closing a run puts the Parquet file of each open chunk beside it before the chunk goes, and some lines in the
ledger: `RunWriter.room_to_close` adds up the files from what is open now. The margin is for the lines, and for
what cannot be added up: what others write to the disk between two looks half a second apart. To begin
takes more than to go on, so that a disk on the edge is not filled with runs of a second each.

Memory of a daemon that runs for months: what closing a chunk took is returned, and nothing is loaded later.
"""

from __future__ import annotations

import ctypes
import re
from collections.abc import Mapping
from contextlib import suppress
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
    path = _fresh_directory(runs, manifest.name)
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


def _fresh_directory(runs: Path, name: str) -> Path:
    stem = name if _TIMED.match(name) else f"{clock.wall_time():%Y%m%dT%H%M%SZ}_{name}"
    for number in count(1):
        path = runs / (stem if number == 1 else f"{stem}.{number}")
        with suppress(FileExistsError):
            durable.make_directory(path)
            return path
    raise AssertionError("count has no end")
