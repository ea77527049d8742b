"""Results that are kept for as long as they are among the most recent ones."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import TypeVar

_Key = TypeVar("_Key", bound=Hashable)
_One = TypeVar("_One")


def recent(kept: dict[_Key, _One], key: _Key, compute: Callable[[], _One], most: int) -> _One:
    """Return what is kept under a key, or compute it; of more than `most` the least recently used one is dropped."""
    found = kept[key] = kept.pop(key) if key in kept else compute()
    if len(kept) > most:
        del kept[next(iter(kept))]
    return found
