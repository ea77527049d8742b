"""A network that delivers late: each piece that is sent waits a random time, and none overtakes another."""

from __future__ import annotations

import random
from collections import deque

from daq import clock
from daq.wire.session import ByteLink


class LateLink:
    """A link whose sendings are late by `jitter_ms` on average, exponentially distributed."""

    def __init__(self, link: ByteLink, jitter_ms: float, seed: int = 0) -> None:
        self._link = link
        self._rate = 1e-6 / jitter_ms
        self._random = random.Random(seed)
        self._waiting: deque[tuple[int, bytes]] = deque()
        self._last_ns = 0

    def read(self, timeout_s: float) -> bytes:
        """Read from the link, and meanwhile send what is due. Raises LinkLost."""
        until_ns = clock.now_ns() + round(timeout_s * 1e9)
        while True:
            self._send_due()
            next_ns = min(until_ns, self._waiting[0][0]) if self._waiting else until_ns
            data = self._link.read(max(0, next_ns - clock.now_ns()) / 1e9)
            if data or clock.now_ns() >= until_ns:
                return data

    def write(self, data: bytes) -> None:
        """Take the data, which is sent when it is due. Raises LinkLost."""
        self._last_ns = max(self._last_ns, clock.now_ns() + round(self._random.expovariate(self._rate)))
        self._waiting.append((self._last_ns, data))
        self._send_due()

    def set_dtr(self, on: bool) -> None:
        """Set the line of the link. Raises LinkLost."""
        self._link.set_dtr(on)

    def _send_due(self) -> None:
        while self._waiting and self._waiting[0][0] <= clock.now_ns():
            self._link.write(self._waiting.popleft()[1])
