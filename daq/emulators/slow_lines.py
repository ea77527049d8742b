"""What a UART makes of characters that were sent at another baud: why wrong line settings look as they do.

The latency timer of an FTDI adapter: bytes wait until it runs out, or until a USB packet is full.

The chip sends what has come once every `latency_ms` (16 unless set), counted from when it last sent; with nothing to
send it sends a packet of status alone, so the timer runs on. A packet carries 62 bytes beside its two of status, and
goes at once when it is full (FTDI application note AN232B-04).

A network that delivers late: each piece that is sent waits a random time, and none overtakes another.
"""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Iterator

from daq import clock
from daq.wire.session import ByteLink
from rigs.schema.links import Line

_LOOKS = 16
"""A bit time: how often a UART looks for the edge that begins a character."""


def heard(data: bytes, sent: Line, at: Line) -> bytes:
    """Return characters sent with one line's settings as the other end receives them with its own.

    Parity is not checked, and a character without its stop bit is passed on, as most drivers do.
    """
    return b"".join(bytes(_characters(_levels(character, sent), sent.baud, at)) for character in data)


def _levels(character: int, line: Line) -> list[int]:
    """The wire during one character, a bit time each: start, data with the lowest bit first, parity, stop."""
    data = [character >> n & 1 for n in range(line.bits)]
    parity = {"N": [], "E": [sum(data) % 2], "O": [1 - sum(data) % 2]}[line.parity]
    return [0, *data, *parity, *[1] * line.stop]


def _characters(levels: list[int], baud: int, at: Line) -> Iterator[int]:
    """Characters that a receiver finds, sampling each bit in its middle; the wire is idle afterwards."""

    def level(bits: float) -> int:
        """Return the level of the line at a time in the receiver's bit times."""
        sent = int(bits * baud / at.baud)
        return levels[sent] if sent < len(levels) else 1

    now, end = 0.0, len(levels) * at.baud / baud
    while now < end:
        if level(now):
            now += 1 / _LOOKS
            continue
        yield sum(level(now + 1.5 + n) << n for n in range(at.bits))
        now += at.bits + 1.5
        while now < end and not level(now):  # no stop bit: a new character cannot begin before the wire is idle
            now += 1 / _LOOKS


_PACKET = 62


class LatencyTimer:
    """Holds bytes back as an FTDI adapter does; times in ns of any one clock. A latency of 0 holds nothing."""

    def __init__(self, latency_ms: float, now_ns: int) -> None:
        self._latency_ns = round(latency_ms * 1e6)
        self._sent_ns = now_ns
        self._held = bytearray()
        self._due_ns = now_ns

    @property
    def due_ns(self) -> int | None:
        """When the bytes must be taken; None if nothing is held."""
        return self._due_ns if self._held else None

    def add(self, data: bytes, now_ns: int) -> None:
        """Take bytes that came through the line."""
        if not self._held:
            self._due_ns = self._next_ns(now_ns)
        self._held += data
        if len(self._held) >= _PACKET:
            self._due_ns = now_ns

    def take(self, now_ns: int) -> bytes:
        """Return what the host gets now; empty before it is due."""
        if not self._held or now_ns < self._due_ns:
            return b""
        data = bytes(self._held)
        self._held.clear()
        self._sent_ns = self._due_ns
        return data

    def _next_ns(self, now_ns: int) -> int:
        if not self._latency_ns:
            return now_ns
        periods = -(-(now_ns - self._sent_ns) // self._latency_ns)
        return self._sent_ns + max(1, periods) * self._latency_ns


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
