"""Instruments with the latching, filtering, delay and rate of `timing` in a rig file, each with a separate clock."""

from __future__ import annotations

import math
import random
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from daq.protocol.conversation import ConversationStep, Device
from rigs.schema.probe import Timing

Read = Callable[[int], Sequence[float]]


class _Wrapped:
    def __init__(self, device: Device) -> None:
        self._device = device

    @property
    def sent(self) -> int:
        return self._device.sent

    def connected(self, now_ns: int) -> ConversationStep:
        return self._after(self._device.connected(self._own(now_ns)), now_ns)

    def received(self, data: bytes, now_ns: int) -> ConversationStep:
        return self._after(self._device.received(data, self._own(now_ns)), now_ns)

    def tick(self, now_ns: int) -> ConversationStep:
        return self._after(self._device.tick(self._own(now_ns)), now_ns)

    def _own(self, host_ns: int) -> int:
        """Time by the clock of the device."""
        return host_ns

    def _after(self, step: ConversationStep, now_ns: int) -> ConversationStep:
        return step


class OwnClock(_Wrapped):
    """Device side with a clock `ppm` faster than the clock of the caller, starting at 0."""

    def __init__(self, make: Callable[[Read], Device], read: Read, ppm: float) -> None:
        self._fast = ppm * 1e-6
        super().__init__(make(lambda own_ns: read(self._host(own_ns))))

    def _own(self, host_ns: int) -> int:
        return host_ns + round(host_ns * self._fast)

    def _host(self, own_ns: int) -> int:
        return own_ns - round(own_ns * self._fast / (1 + self._fast))

    def _after(self, step: ConversationStep, now_ns: int) -> ConversationStep:
        # A delay of 1 ns prevents rounding from waking the device early.
        return step if step.wake_ns is None else replace(step, wake_ns=self._host(step.wake_ns) + 1)


_DRIFT_S = 40.0
"""Period of the slow rate variation: as long as a lap, so it does not average out."""


@dataclass(frozen=True)
class Unsteady:
    """Irregularity of a cycle: the crystal has an offset and drifts, and a busy processor delays or skips ticks."""

    ppm: float = 0.0
    """Limit of the rate error, with a variation of half of it."""
    jitter: float = 0.0
    """Limit per tick, as a share of a cycle."""
    missed: float = 0.0
    """Share of ticks that do not update the value."""
    pace: float = 0.0
    """Limit per interval, accumulating."""


STEADY = Unsteady()


class OwnCycle:
    """Instrument with an internal cycle. It reads at every tick and shows the mean of `length` readings."""

    def __init__(self, read: Read, cycle_ns: float, length: int, unsteady: Unsteady, chance: random.Random) -> None:
        self._read = read
        self._cycle_ns = cycle_ns
        self._unsteady = unsteady
        self._chance = chance
        self._off = chance.uniform(-unsteady.ppm, unsteady.ppm) * 1e-6
        self._latched: deque[Sequence[float]] = deque(maxlen=length)
        self._grid_ns = math.nan
        self._tick_ns = 0

    def __call__(self, now_ns: int) -> list[float]:
        """Reading at now_ns, which must not decrease between calls."""
        if math.isnan(self._grid_ns):
            self._grid_ns = now_ns - (self._chance.random() + (self._latched.maxlen or 1)) * self._cycle_ns
            self._next()
            self._latched.append(self._read(self._tick_ns))
            self._next()
        while self._tick_ns <= now_ns:
            if self._chance.random() >= self._unsteady.missed:
                self._latched.append(self._read(self._tick_ns))
            self._next()
        return [sum(values) / len(self._latched) for values in zip(*self._latched, strict=True)]

    def _next(self) -> None:
        swing = 0.5e-6 * self._unsteady.ppm * math.sin(2 * math.pi * self._grid_ns / (_DRIFT_S * 1e9))
        uneven = self._chance.uniform(-self._unsteady.pace, self._unsteady.pace)
        self._grid_ns += self._cycle_ns * (1 + self._off + swing + uneven)
        jitter = self._unsteady.jitter * self._cycle_ns
        self._tick_ns = round(self._grid_ns + self._chance.uniform(-jitter, jitter))


def timed_read(read: Read, timing: Timing, unsteady: Unsteady, chance: random.Random) -> Read:
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
    if timing.latch == "streamed" and timing.cycle_ms is not None:
        return _Paced(device, timing.cycle_ms * 1e6, unsteady.pace, chance)
    return _Late(device, round(timing.answer_delay_ms * 1e6)) if timing.answer_delay_ms else device


class _Late(_Wrapped):
    """Instrument that latches on request and answers after `delay_ns`."""

    def __init__(self, device: Device, delay_ns: int) -> None:
        super().__init__(device)
        self._delay_ns = delay_ns
        self._answers: deque[tuple[int, ConversationStep]] = deque()

    def received(self, data: bytes, now_ns: int) -> ConversationStep:
        answer = self._device.received(data, now_ns)
        if not answer.send:
            return self._after(answer, now_ns)
        self._answers.append((now_ns + self._delay_ns, answer))
        return ConversationStep(wake_ns=self._answers[0][0])

    def tick(self, now_ns: int) -> ConversationStep:
        is_due = bool(self._answers) and self._answers[0][0] <= now_ns
        return self._after(self._answers.popleft()[1] if is_due else self._device.tick(now_ns), now_ns)

    def _after(self, step: ConversationStep, now_ns: int) -> ConversationStep:
        due = [at for at in (step.wake_ns, self._answers[0][0] if self._answers else None) if at is not None]
        return replace(step, wake_ns=min(due, default=None))


class _Paced(_Wrapped):
    def __init__(self, device: Device, pace_ns: float, uneven: float, chance: random.Random) -> None:
        super().__init__(device)
        self._pace_ns = pace_ns
        self._uneven = uneven
        self._chance = chance
        self._next_ns = 0

    def tick(self, now_ns: int) -> ConversationStep:
        if now_ns < self._next_ns:
            return ConversationStep(wake_ns=self._next_ns)
        interval = self._pace_ns * (1 + self._chance.uniform(-self._uneven, self._uneven))
        self._next_ns = now_ns + round(interval)
        return super().tick(now_ns)

    def _after(self, step: ConversationStep, now_ns: int) -> ConversationStep:
        at_once = step.wake_ns is not None and step.wake_ns <= now_ns
        return replace(step, wake_ns=max(self._next_ns, now_ns)) if at_once else step


class Scheduled(Protocol):
    free_ns: int
    """Time at which all data is or will be sent."""

    def set_out(self, at_ns: int) -> None:
        """Start the next transmission at this time, even in the past."""


class Punctual(_Wrapped):
    """Instrument that acts at the requested wake-up time, or when the line becomes free if that is later.

    A real serial gauge keeps the pace of the UART, no matter how late a computer wakes up.
    """

    def __init__(self, device: Device, line: Scheduled) -> None:
        super().__init__(device)
        self._line = line
        self._wake_ns: int | None = None

    def tick(self, now_ns: int) -> ConversationStep:
        asked_ns = now_ns if self._wake_ns is None else self._wake_ns
        at_ns = min(now_ns, max(asked_ns, self._line.free_ns))
        step = super().tick(at_ns)
        if step.send:
            self._line.set_out(at_ns)
        return step

    def _after(self, step: ConversationStep, now_ns: int) -> ConversationStep:
        self._wake_ns = step.wake_ns
        return step
