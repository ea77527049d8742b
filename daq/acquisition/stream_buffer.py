"""Buffer between a reader and the recorder.

The reader never waits for the disk or other threads. The buffer is bounded: excess samples are counted as dropped, and
excess faults are merged by kind.
"""

from __future__ import annotations

import math
import threading
from collections import Counter, deque
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np

from daq import clock
from daq.protocol.conversation import Fault, FaultKind, Item, Sample, SampleBlock, packed

_ROOM = 200_000
"""Items buffered for a stalled disk: minutes at 500 Hz, and about 100 MB in the worst case."""
_FEW = 8
"""Samples for which objects are cheaper than arrays."""
_RATE_OVER = 200
_RECENT = 1000
"""Drained samples that remain available to a live view: a tenth of a second at 10 kHz."""
STALL_NS = 500_000_000
"""Longest interval between heartbeats: a reader loop takes at most 0.3 s, and a busy computer adds a few tenths."""


@dataclass(frozen=True)
class StreamState:
    connected: bool
    rate_hz: float
    last: dict[str, float]
    age_s: dict[str, float]
    counters: dict[str, int]
    last_fault: str
    waiting: int
    """Number of items that the recorder has not taken."""


@dataclass
class StreamBuffer:
    """Thread-safe buffer of a stream. A single reader delivers and a single recorder drains."""

    name: str
    columns: tuple[str, ...]
    heartbeat_ns: int = 0
    """Time of the last completed reader loop, for the watchdog."""
    connected: bool = False
    _opening: bool = False
    _lock: threading.Lock = field(default_factory=threading.Lock)
    _items: deque[Item] = field(default_factory=deque)
    _waiting: int = 0
    _without_room: Counter[FaultKind] = field(default_factory=Counter)
    """Dropped samples, and dropped faults by kind."""
    _counters: Counter[str] = field(default_factory=Counter)
    _last: dict[str, tuple[float, int]] = field(default_factory=dict)
    _arrivals: deque[tuple[int, int]] = field(default_factory=lambda: deque(maxlen=_RATE_OVER))
    """Recent deliveries: timestamp of the last sample, and number of samples up to it."""
    _last_fault: str = ""
    _is_faulty: bool = False
    """True if the instrument or its line has reported a fault since the last reading."""
    _recent: deque[Sample | SampleBlock] = field(default_factory=deque)
    _recent_size: int = 0

    def deliver(self, items: Sequence[Item]) -> None:
        if len(items) > _FEW:
            items = packed(items)
        with self._lock:
            newest: Sample | SampleBlock | None = None
            for item in items:
                size = size_of(item)
                self._note(item, size)
                if not isinstance(item, Fault):
                    newest = item
                if self._waiting + size <= _ROOM:
                    self._items.append(item)
                    self._waiting += size
                elif isinstance(item, Fault):
                    self._without_room[item.kind] += item.count
                else:
                    self._without_room[FaultKind.DROPPED] += size
                    self._counters[FaultKind.DROPPED] += size
            if newest is not None:
                last_ns = newest.last_byte_ns if isinstance(newest, Sample) else newest.last_byte_ns[-1]
                self._arrivals.append((int(last_ns), self._counters["samples"]))

    def count(self, faults: Sequence[Fault]) -> None:
        """Count faults that the recorder has found and written. They are not delivered."""
        with self._lock:
            for fault in faults:
                self._note(fault, 1)

    def drain(self) -> list[SampleBlock | Fault]:
        with self._lock:
            taken, self._items = self._items, deque()
            self._waiting = 0
            lost, self._without_room = self._without_room, Counter()
        items, now_ns = packed(taken), clock.now_ns()
        for kind, count in lost.items():
            items_lost = "samples" if kind is FaultKind.DROPPED else "faults"
            items.append(Fault(kind, now_ns, f"{count} {items_lost} were dropped while the disk was slow", count))
        return items

    def beat(self) -> None:
        now_ns, before_ns = clock.now_ns(), self.heartbeat_ns
        self.heartbeat_ns = now_ns
        if before_ns and now_ns - before_ns > STALL_NS and not self._opening:
            detail = (
                f"the reader did not run for {(now_ns - before_ns) / 1e9:.1f} s; messages received meanwhile have late "
                "timestamps"
            )
            self.deliver([Fault(FaultKind.STALLED, now_ns, detail)])

    @contextmanager
    def opening(self) -> Iterator[None]:
        self._opening = True
        try:
            yield
        finally:
            self.beat()
            self._opening = False

    def alive(self, within_s: float) -> bool:
        """True if the reader completed a loop within this time, or is opening the port."""
        return self._opening or clock.now_ns() - self.heartbeat_ns < within_s * 1e9

    def state(self) -> StreamState:
        now = clock.now_ns()
        with self._lock:
            rate_hz = 0.0
            if len(self._arrivals) >= 2 and now - self._arrivals[-1][0] <= 2_000_000_000:
                (first_ns, before), (last_ns, until) = self._arrivals[0], self._arrivals[-1]
                rate_hz = (until - before) * 1e9 / (last_ns - first_ns) if last_ns > first_ns else 0.0
            return StreamState(
                self.connected,
                rate_hz,
                {name: value for name, (value, _) in self._last.items()},
                {name: (now - at) / 1e9 for name, (_, at) in self._last.items()},
                dict(self._counters),
                self._last_fault,
                self._waiting,
            )

    def recent(self, after: int) -> tuple[int, Sequence[Sample]]:
        """Number of the newest sample since start-up, and the available samples after number `after`."""
        with self._lock:
            newest, kept = self._counters["samples"], list(self._recent)
        requested, available, taken = newest - after, 0, list[Item]()
        while kept and available < requested:
            taken.append(kept.pop())
            available += size_of(taken[-1])
        return newest, samples_of(taken[::-1])[-requested:] if requested > 0 else []

    def _note(self, item: Item, size: int) -> None:
        if isinstance(item, Fault):
            self._counters[item.kind] += item.count
            is_stall = item.kind is FaultKind.STALLED
            if not (is_stall and self._is_faulty):  # a short stall must not hide a fault of the instrument
                self._last_fault, self._is_faulty = item.detail, not is_stall
            return
        self._is_faulty = False
        self._counters["samples"] += size
        self._recent.append(item)
        self._recent_size += size
        while self._recent_size - (oldest := size_of(self._recent[0])) >= _RECENT:
            self._recent.popleft()
            self._recent_size -= oldest
        if not isinstance(item, Sample):
            for name, values in zip(self.columns, item.values.T, strict=True):
                good = np.flatnonzero(~np.isnan(values))
                if good.size:
                    self._last[name] = (float(values[good[-1]]), int(item.last_byte_ns[good[-1]]))
            return
        for name, value in zip(self.columns, item.values, strict=True):
            if not math.isnan(value):
                self._last[name] = (value, item.last_byte_ns)


def size_of(item: Item) -> int:
    # Compare types: an isinstance check for Sequence costs a tenth of a poll.
    return len(item) if type(item) is SampleBlock else 1


def samples_of(items: Sequence[Item]) -> SampleBlock:
    return SampleBlock.joined([item for item in packed(items) if isinstance(item, SampleBlock)])


def faults_of(items: Sequence[Item]) -> list[Fault]:
    return [item for item in items if isinstance(item, Fault)]


KEPT_NS = 5_000_000_000


class PretriggerBuffer:
    """Items of the last five seconds: a run started by the robot's signal contains the samples from before it."""

    def __init__(self, streams: Iterable[str]) -> None:
        self._items: dict[str, deque[SampleBlock | Fault]] = {name: deque() for name in streams}

    def add(self, stream: str, items: Sequence[Item]) -> None:
        self._items[stream].extend(packed(items))

    def trim(self) -> None:
        """Drop items more than five seconds older than the newest, once per round, so that long rounds are complete."""
        for kept in self._items.values():
            while kept and _newest_ns(kept[0]) < _newest_ns(kept[-1]) - KEPT_NS:
                kept.popleft()

    def since(self, stream: str, since_ns: int) -> list[SampleBlock | Fault]:
        cut = (
            item.chosen(item.first_byte_ns >= since_ns) if isinstance(item, SampleBlock) else item
            for item in self._items[stream]
            if _newest_ns(item) >= since_ns
        )
        return list(cut)


def _newest_ns(item: SampleBlock | Fault) -> int:
    return int(item.first_byte_ns[-1]) if isinstance(item, SampleBlock) else item.at_ns
