"""How much room a recording needs on its disk, so that it ends cleanly while there still is some.

Closing a run puts the Parquet file of each open chunk beside it before the chunk goes, and some lines in the
ledger: `RunWriter.room_to_close` adds up the files from what is open now. The margin is for the lines, and for
what cannot be added up: what others write to the disk between two looks half a second apart. To begin
takes more than to go on, so that a disk on the edge is not filled with runs of a second each.

Memory of a daemon that runs for months: what closing a chunk took is returned, and nothing is loaded later.
"""

from __future__ import annotations

import ctypes
from pathlib import Path

import pyarrow as pa

from daq.store import durable
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
