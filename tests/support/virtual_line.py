"""Both sides of a protocol joined by a line in simulated time, character by character.

All delays of real timestamps are included: transmission time of request and answer, processing time of the instrument,
an adapter that buffers bytes, network jitter, and a host that wakes up late.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable
from dataclasses import dataclass
from itertools import count

from daq.emulators.pty_line import LatencyTimer
from daq.protocol.conversation import Conversation, ConversationStep, Device, Item


@dataclass(frozen=True)
class Wire:
    """Delays of a line. character_ns: duration of a character, 0 for a network. latency_ms: timer of an FTDI
    adapter. latch_ns, answer_ns: from the end of a request to the reading and to the first character of the
    answer. late_ns: delay of the host after adapter or controller; the order is preserved.
    """

    character_ns: int = 0
    latency_ms: float = 0.0
    latch_ns: Callable[[], int] = lambda: 0
    answer_ns: Callable[[], int] = lambda: 0
    late_ns: Callable[[], int] = lambda: 0


def run(host: Conversation, device: Device, wire: Wire, until_ns: int) -> list[Item]:
    """Run both sides until a time and return the items decoded by the host."""
    return _Run(host, device, wire).to(until_ns)


class _Run:
    def __init__(self, host: Conversation, device: Device, wire: Wire) -> None:
        self.host, self.device, self.wire = host, device, wire
        self.items: list[Item] = []
        self._events: list[tuple[int, int, Callable[[int], None]]] = []
        self._numbers = count()
        self._out_free_ns = self._in_free_ns = self._read_ns = 0
        self._awaited = {"host": 0, "device": 0}
        self._adapter = LatencyTimer(wire.latency_ms, 0)

    def to(self, until_ns: int) -> list[Item]:
        self._at(0, lambda now: self._device_does(self.device.connected(now), now))
        self._at(0, lambda now: self._host_does(self.host.connected(now), now))
        while self._events and self._events[0][0] <= until_ns:
            now_ns, _, act = heapq.heappop(self._events)
            act(now_ns)
        return self.items

    def _at(self, at_ns: int, act: Callable[[int], None]) -> None:
        heapq.heappush(self._events, (at_ns, next(self._numbers), act))

    def _wake(self, side: str, at_ns: int, act: Callable[[int], None]) -> None:
        """Wake a side at a time unless another event for it comes first."""
        self._awaited[side] = number = next(self._numbers)
        self._at(at_ns, lambda now: act(now) if self._awaited[side] == number else None)

    def _host_does(self, step: ConversationStep, now_ns: int) -> None:
        self.items += step.items
        self._awaited["host"] = -1
        if step.wake_ns is not None:
            self._wake("host", max(step.wake_ns, now_ns), lambda now: self._host_does(self.host.tick(now), now))
        if step.send:
            self._out_free_ns = max(self._out_free_ns, now_ns) + len(step.send) * self.wire.character_ns
            self._at(self._out_free_ns, lambda now: self._ask(step.send, now))

    def _ask(self, data: bytes, now_ns: int) -> None:
        latch_ns = self.wire.latch_ns()
        begin_ns = now_ns + max(latch_ns, self.wire.answer_ns())
        self._at(now_ns + latch_ns, lambda now: self._device_does(self.device.received(data, now), begin_ns))

    def _device_does(self, step: ConversationStep, begin_ns: int) -> None:
        self._awaited["device"] = -1
        self._in_free_ns = max(self._in_free_ns, begin_ns) if step.send else self._in_free_ns
        pieces = [bytes([byte]) for byte in step.send] if self.wire.character_ns else [step.send] if step.send else []
        for piece in pieces:
            self._in_free_ns += self.wire.character_ns
            self._at(self._in_free_ns, lambda now, piece=piece: self._through(piece, now))  # type: ignore[misc]
        if step.wake_ns is not None:
            at_ns = max(step.wake_ns, self._in_free_ns)
            self._wake("device", at_ns, lambda now: self._device_does(self.device.tick(now), now))

    def _through(self, piece: bytes, now_ns: int) -> None:
        self._adapter.add(piece, now_ns)
        if self._adapter.due_ns is not None:
            self._at(self._adapter.due_ns, self._release)

    def _release(self, now_ns: int) -> None:
        if data := self._adapter.take(now_ns):
            self._read_ns = max(self._read_ns, now_ns + self.wire.late_ns())
            self._at(self._read_ns, lambda now: self._host_does(self.host.received(data, now), now))
