"""The latency timer of an FTDI adapter: bytes wait until it runs out, or until a USB packet is full.

The chip sends what has come once every `latency_ms` (16 unless set), counted from when it last sent; with nothing to
send it sends a packet of status alone, so the timer runs on. A packet carries 62 bytes beside its two of status, and
goes at once when it is full (FTDI application note AN232B-04).
"""

from __future__ import annotations

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
