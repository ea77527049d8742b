"""Memory of a daemon that runs for months: what closing a chunk took is returned, and nothing is loaded later."""

from __future__ import annotations

import ctypes

import pyarrow as pa

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
