"""The buffer between a reader and the recorder: what one stream has delivered and is not written yet.

The reader only ever appends here; it waits for no disk and no other thread. Room is bounded, and items that
find none are counted as a fault of its own kind.
"""

from __future__ import annotations

import math
import threading
import time
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

from daq.protocol.conversation import Fault, FaultKind, Item, Sample

_ROOM = 200_000
"""Items held for a stalled disk: minutes at 500 Hz, some 100 MB at the worst."""
_RATE_OVER = 200
"""Deliveries over which the rate is taken."""
_RECENT = 1000
"""Samples that a live view may still ask for after they were drained: a tenth of a second at 10 kHz."""
STALL_NS = 500_000_000
"""A reader goes round in 0.2 s at most (`daq.wire.session`); a busy computer adds some tenths."""


@dataclass(frozen=True)
class StreamState:
    """The state of a stream as it is shown to people.

    last: column → last good value; age_s: column → time since then.
    """

    connected: bool
    rate_hz: float
    last: dict[str, float]
    age_s: dict[str, float]
    counters: dict[str, int]
    last_fault: str
    waiting: int
    """Items that the recorder has not taken yet."""


@dataclass
class StreamBuffer:
    """Holds the items of one stream; thread-safe: one reader delivers, one recorder drains, any thread may ask."""

    name: str
    columns: tuple[str, ...]
    heartbeat_ns: int = 0
    """When the reader last completed its loop, with or without data; the watchdog depends on it."""
    connected: bool = False
    _opening: bool = False
    _lock: threading.Lock = field(default_factory=threading.Lock)
    _items: deque[Item] = field(default_factory=deque)
    _dropped: int = 0
    _counters: Counter[str] = field(default_factory=Counter)
    _last: dict[str, tuple[float, int]] = field(default_factory=dict)
    _arrivals: deque[tuple[int, int]] = field(default_factory=lambda: deque(maxlen=_RATE_OVER))
    """The last deliveries: stamp of the last sample, and number of samples until then."""
    _last_fault: str = ""
    _recent: deque[Sample] = field(default_factory=lambda: deque(maxlen=_RECENT))

    def deliver(self, items: Sequence[Item]) -> None:
        """Keep items that the reader has received."""
        with self._lock:
            for item in items:
                self._note(item)
                if len(self._items) < _ROOM:
                    self._items.append(item)
                else:
                    self._dropped += 1
                    self._counters[FaultKind.DROPPED] += 1
            if items and isinstance(items[-1], Sample):
                self._arrivals.append((items[-1].last_byte_ns, self._counters["samples"]))

    def count(self, faults: Sequence[Fault]) -> None:
        """Count faults that the recorder found itself and has written into the run; they are not delivered again."""
        with self._lock:
            for fault in faults:
                self._note(fault)

    def drain(self) -> list[Item]:
        """Return everything since the last call, in order, for the recorder."""
        with self._lock:
            items = list(self._items)
            self._items.clear()
            if self._dropped:
                detail = f"{self._dropped} items found no room while the disk was behind"
                items.append(Fault(FaultKind.DROPPED, time.monotonic_ns(), detail, self._dropped))
                self._dropped = 0
        return items

    def beat(self) -> None:
        """Note that the reader is still running, and report how long it stood still if it did."""
        now_ns, before_ns = time.monotonic_ns(), self.heartbeat_ns
        self.heartbeat_ns = now_ns
        if before_ns and now_ns - before_ns > STALL_NS and not self._opening:
            what = f"its reader stood still for {(now_ns - before_ns) / 1e9:.1f} s; what came meanwhile is stamped late"
            self.deliver([Fault(FaultKind.STALLED, now_ns, what)])

    @contextmanager
    def opening(self) -> Iterator[None]:
        """Mark the time in which the reader waits for the system to open a port, which may need name resolution."""
        self._opening = True
        try:
            yield
        finally:
            self.beat()
            self._opening = False

    def alive(self, within_s: float) -> bool:
        """Return whether the reader completed its loop within this time, or is opening its port."""
        return self._opening or time.monotonic_ns() - self.heartbeat_ns < within_s * 1e9

    def state(self) -> StreamState:
        """Return the state of the stream as of now."""
        now = time.monotonic_ns()
        with self._lock:
            return StreamState(
                self.connected,
                self._rate_hz(now),
                {name: value for name, (value, _) in self._last.items()},
                {name: (now - at) / 1e9 for name, (_, at) in self._last.items()},
                dict(self._counters),
                self._last_fault,
                len(self._items),
            )

    def recent(self, after: int) -> tuple[int, list[Sample]]:
        """Return the number of the newest sample, counted since the daemon started, and the samples after number
        `after`, as far as they are still kept."""
        with self._lock:
            newest = self._counters["samples"]
            kept = list(self._recent) if newest > after else []
        return newest, kept[-(newest - after) :] if newest > after else []

    def _note(self, item: Item) -> None:
        if isinstance(item, Fault):
            self._counters[item.kind] += item.count
            self._last_fault = item.detail
            return
        self._counters["samples"] += 1
        self._recent.append(item)
        for name, value in zip(self.columns, item.values, strict=True):
            if not math.isnan(value):
                self._last[name] = (value, item.last_byte_ns)

    def _rate_hz(self, now: int) -> float:
        if len(self._arrivals) < 2 or now - self._arrivals[-1][0] > 2_000_000_000:
            return 0.0
        (first_ns, before), (last_ns, until) = self._arrivals[0], self._arrivals[-1]
        return (until - before) * 1e9 / (last_ns - first_ns) if last_ns > first_ns else 0.0


def samples_of(items: Sequence[Item]) -> list[Sample]:
    """Return the samples among items."""
    return [item for item in items if isinstance(item, Sample)]


def faults_of(items: Sequence[Item]) -> list[Fault]:
    """Return the faults among items."""
    return [item for item in items if isinstance(item, Fault)]
