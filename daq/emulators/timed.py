"""Instruments that latch, filter, wait and pace as a rig file's `timing` says of them."""

from __future__ import annotations

import random
from collections import deque
from dataclasses import replace

from daq.emulators.own_cycle import OwnCycle, Read, Unsteady
from daq.protocol.conversation import Device, Step
from rigs.schema.timing import Timing


def timed_read(read: Read, timing: Timing, unsteady: Unsteady, chance: random.Random) -> Read:
    """Return a function for what the instrument shows of what `read` measures."""
    if timing.latch == "own_cycle" and timing.cycle_ms is not None:
        length = 1 + round(2 * timing.filter_ms / timing.cycle_ms)
        return OwnCycle(read, timing.cycle_ms * 1e6, length, unsteady, chance)
    if not timing.filter_ms:
        return read
    delay_ns = round(timing.filter_ms * 1e6)

    def averaged(now_ns: int) -> list[float]:
        readings = [read(now_ns - back * delay_ns) for back in (2, 1, 0)]
        return [sum(values) / len(values) for values in zip(*readings, strict=True)]

    return averaged


def timed_device(device: Device, timing: Timing, unsteady: Unsteady, chance: random.Random) -> Device:
    """Return the instrument's side of its protocol, answering late or streaming at a pace."""
    if timing.latch == "streamed" and timing.cycle_ms is not None:
        return _Paced(device, timing.cycle_ms * 1e6, unsteady.pace, chance)
    return _Late(device, round(timing.answer_delay_ms * 1e6)) if timing.answer_delay_ms else device


class _Late:
    """An instrument that latches when it is asked and answers `delay_ns` later."""

    def __init__(self, device: Device, delay_ns: int) -> None:
        self._device = device
        self._delay_ns = delay_ns
        self._answers: deque[tuple[int, Step]] = deque()

    @property
    def sent(self) -> int:
        return self._device.sent

    def connected(self, now_ns: int) -> Step:
        return self._device.connected(now_ns)

    def received(self, data: bytes, now_ns: int) -> Step:
        answer = self._device.received(data, now_ns)
        if not answer.send:
            return replace(answer, wake_ns=self._due_ns(answer.wake_ns))
        self._answers.append((now_ns + self._delay_ns, answer))
        return Step(wake_ns=self._answers[0][0])

    def tick(self, now_ns: int) -> Step:
        if self._answers and self._answers[0][0] <= now_ns:
            answer = self._answers.popleft()[1]
            return replace(answer, wake_ns=self._due_ns(answer.wake_ns))
        step = self._device.tick(now_ns)
        return replace(step, wake_ns=self._due_ns(step.wake_ns))

    def _due_ns(self, wake_ns: int | None) -> int | None:
        due = [at for at in (wake_ns, self._answers[0][0] if self._answers else None) if at is not None]
        return min(due, default=None)


class _Paced:
    """A streaming instrument that would send whenever its line is free, held to a pace."""

    def __init__(self, device: Device, pace_ns: float, uneven: float, chance: random.Random) -> None:
        self._device = device
        self._pace_ns = pace_ns
        self._uneven = uneven
        self._chance = chance
        self._next_ns = 0

    @property
    def sent(self) -> int:
        return self._device.sent

    def connected(self, now_ns: int) -> Step:
        return self._held(self._device.connected(now_ns), now_ns)

    def received(self, data: bytes, now_ns: int) -> Step:
        return self._held(self._device.received(data, now_ns), now_ns)

    def tick(self, now_ns: int) -> Step:
        if now_ns < self._next_ns:
            return Step(wake_ns=self._next_ns)
        interval = self._pace_ns * (1 + self._chance.uniform(-self._uneven, self._uneven))
        self._next_ns = now_ns + round(interval)
        return self._held(self._device.tick(now_ns), now_ns)

    def _held(self, step: Step, now_ns: int) -> Step:
        at_once = step.wake_ns is not None and step.wake_ns <= now_ns
        return replace(step, wake_ns=max(self._next_ns, now_ns)) if at_once else step
