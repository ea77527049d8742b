"""The last seconds of every stream, kept whether or not a recording runs: what came before a robot's signal was
understood belongs to the run that it starts."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence

from daq.protocol.conversation import Fault, Item, Samples, packed

KEPT_NS = 5_000_000_000


class PretriggerBuffer:
    """Holds the items of the last five seconds and of the rounds since then: some thousands for each stream."""

    def __init__(self, streams: Iterable[str]) -> None:
        self._items: dict[str, deque[Samples | Fault]] = {name: deque() for name in streams}

    def add(self, stream: str, items: Sequence[Item]) -> None:
        """Keep items that have come on a stream."""
        self._items[stream].extend(packed(items))

    def trim(self) -> None:
        """Drop what is five seconds older than the newest item; once a round, so that a long round stays whole."""
        for kept in self._items.values():
            while kept and _newest_ns(kept[0]) < _newest_ns(kept[-1]) - KEPT_NS:
                kept.popleft()

    def since(self, stream: str, since_ns: int) -> list[Samples | Fault]:
        """Return what came from `since_ns` on, in order."""
        cut = (
            item.chosen(item.first_byte_ns >= since_ns) if isinstance(item, Samples) else item
            for item in self._items[stream]
            if _newest_ns(item) >= since_ns
        )
        return list(cut)


def _newest_ns(item: Samples | Fault) -> int:
    return int(item.first_byte_ns[-1]) if isinstance(item, Samples) else item.at_ns
