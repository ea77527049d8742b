"""An instrument on a serial line that keeps time by its own crystal, however late its computer wakes it.

A real gauge that sends whenever its line is free keeps the pace of its UART. An emulated one that went on from where a
busy computer woke it would wait a little after every message, more or less as the load changes, and its pace would be
no pace.
"""

from __future__ import annotations

from typing import Protocol

from daq.protocol.conversation import Device, Step


class Scheduled(Protocol):
    """A line that sends on an absolute schedule."""

    free_ns: int
    """When it has sent, or will have sent, all that it was given."""

    def set_out(self, at_ns: int) -> None:
        """Let what is written next start at this time, even if it has passed."""


class Punctual:
    """An instrument that acts at the time it asked to be woken, or when its line became free, if that was later."""

    def __init__(self, device: Device, line: Scheduled) -> None:
        self._device = device
        self._line = line
        self._wake_ns: int | None = None

    @property
    def sent(self) -> int:
        return self._device.sent

    def connected(self, now_ns: int) -> Step:
        return self._noted(self._device.connected(now_ns))

    def received(self, data: bytes, now_ns: int) -> Step:
        return self._noted(self._device.received(data, now_ns))

    def tick(self, now_ns: int) -> Step:
        asked_ns = now_ns if self._wake_ns is None else self._wake_ns
        at_ns = min(now_ns, max(asked_ns, self._line.free_ns))
        step = self._noted(self._device.tick(at_ns))
        if step.send:
            self._line.set_out(at_ns)
        return step

    def _noted(self, step: Step) -> Step:
        self._wake_ns = step.wake_ns
        return step
