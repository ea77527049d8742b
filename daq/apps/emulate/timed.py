"""Instruments that latch, filter, wait and pace as a rig file's `timing` says of them, each by a clock of its own.

Such a clock runs at its own rate: everything the instrument does and stamps drifts against the host's clock.

An instrument with a cycle of its own answers with the last of it. No real cycle is perfect: its crystal is off and
drifts, a busy processor is late at a tick or leaves one out.

A real gauge on a serial line that sends whenever its line is free keeps the pace of its UART, however late its computer
wakes it. An emulated one that went on from where a busy computer woke it would wait a little after every message, more
or less as the load changes, and its pace would be no pace.
"""

from __future__ import annotations

import math
import random
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from daq.protocol.conversation import Device, Step
from rigs.schema.probe import Timing

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


_DRIFT_S = 40.0
"""Period of the slow swing of a cycle: as long as a lap takes, so that it does not average out."""


@dataclass(frozen=True)
class Unsteady:
    """How far a cycle is from steady.

    ppm: its rate, off by up to this and swinging by half of it; jitter: each tick, by up to this share of a cycle;
    missed: share of the ticks at which nothing new is read; pace: each interval, by up to this share, the next being
    counted from there.
    """

    ppm: float = 0.0
    jitter: float = 0.0
    missed: float = 0.0
    pace: float = 0.0


STEADY = Unsteady()


class OwnCycle:
    """What an instrument with its own cycle shows: it reads at every tick and shows the mean of `length` readings."""

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
        """The reading at now_ns, which never falls from call to call."""
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
