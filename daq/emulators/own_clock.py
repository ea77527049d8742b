"""An instrument whose clock runs at its own rate: everything it does and stamps drifts against the host's clock."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from daq.protocol.conversation import Device, Step

Read = Callable[[int], Sequence[float]]


class OwnClock:
    """A device's side on a clock that runs `ppm` fast against the clock of its caller, from 0 on."""

    def __init__(self, make: Callable[[Read], Device], read: Read, ppm: float) -> None:
        """`make` makes the device from what it reads; `read` is asked in the host's time."""
        self._fast = ppm * 1e-6
        self._device = make(lambda own_ns: read(self._host(own_ns)))

    @property
    def sent(self) -> int:
        return self._device.sent

    def connected(self, now_ns: int) -> Step:
        return self._step(self._device.connected(self._own(now_ns)))

    def received(self, data: bytes, now_ns: int) -> Step:
        return self._step(self._device.received(data, self._own(now_ns)))

    def tick(self, now_ns: int) -> Step:
        return self._step(self._device.tick(self._own(now_ns)))

    def _own(self, host_ns: int) -> int:
        return host_ns + round(host_ns * self._fast)

    def _host(self, own_ns: int) -> int:
        return own_ns - round(own_ns * self._fast / (1 + self._fast))

    def _step(self, step: Step) -> Step:
        # One ns later than the device asked, so that rounding never wakes it before its time.
        return step if step.wake_ns is None else replace(step, wake_ns=self._host(step.wake_ns) + 1)
