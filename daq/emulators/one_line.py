"""Several instruments on one line: each hears everything, and answers what is addressed to it."""

from __future__ import annotations

from collections.abc import Sequence

from daq.protocol.conversation import Device, Step


class OneLine:
    """The side of all instruments on a line."""

    def __init__(self, devices: Sequence[Device]) -> None:
        self._devices = devices
        self._wakes: list[int | None] = [None] * len(devices)

    @property
    def sent(self) -> int:
        return sum(device.sent for device in self._devices)

    def connected(self, now_ns: int) -> Step:
        return self._joined([device.connected(now_ns) for device in self._devices])

    def received(self, data: bytes, now_ns: int) -> Step:
        return self._joined([device.received(data, now_ns) for device in self._devices])

    def tick(self, now_ns: int) -> Step:
        due = [wake_ns is not None and wake_ns <= now_ns for wake_ns in self._wakes]
        asleep = [Step(wake_ns=wake_ns) for wake_ns in self._wakes]
        return self._joined([device.tick(now_ns) if due[n] else asleep[n] for n, device in enumerate(self._devices)])

    def _joined(self, steps: Sequence[Step]) -> Step:
        self._wakes = [step.wake_ns for step in steps]
        wake_ns = min((wake_ns for wake_ns in self._wakes if wake_ns is not None), default=None)
        return Step(b"".join(step.send for step in steps), (), wake_ns, any(step.hang_up for step in steps))
