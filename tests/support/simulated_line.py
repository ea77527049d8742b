"""A half-duplex serial line in simulated time, with its baud rate and units that require the silent interval.

Written from the Modbus serial line specification: a unit detects the start of a frame by the preceding silence. A
request too soon after the previous frame is therefore ignored.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from daq.protocol.conversation import Conversation, Device, Item

TURNAROUND_NS = 2_000_000


@dataclass
class SimulatedLine:
    """A serial line. character_ns: duration of a character; silence_ns: required before a request; other: frames of
    another master, with their times in ns.
    """

    character_ns: int
    silence_ns: int = 0
    delay_ns: Callable[[], int] = lambda: TURNAROUND_NS
    echo: bool = False
    other: list[tuple[int, bytes]] = field(default_factory=list)
    unheard: int = 0
    """Number of requests too soon after a frame."""

    def run(self, host: Conversation, device: Device, until_ns: int) -> list[Item]:
        items: list[Item] = []
        coming: list[tuple[int, bytes]] = sorted(self.other)
        ended_ns = -self.silence_ns
        now_ns = 0
        step = host.connected(now_ns)
        while True:
            items += step.items
            if step.send:
                heard = now_ns - ended_ns >= self.silence_ns
                self.unheard += not heard
                ended_ns = now_ns + len(step.send) * self.character_ns
                if self.echo:
                    coming.append((ended_ns, step.send))
                answer = device.received(step.send, ended_ns).send if heard else b""
                if answer:
                    ended_ns += self.delay_ns() + len(answer) * self.character_ns
                    coming.append((ended_ns, answer))
                coming.sort()
            arrives_ns = coming[0][0] if coming else until_ns
            wakes_ns = until_ns if step.wake_ns is None else max(step.wake_ns, now_ns)
            now_ns = min(arrives_ns, wakes_ns)
            if now_ns >= until_ns:
                return items
            if coming and arrives_ns <= wakes_ns:
                _, data = coming.pop(0)
                ended_ns = max(ended_ns, now_ns)
                step = host.received(data, now_ns)
            else:
                step = host.tick(now_ns)
