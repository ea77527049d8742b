"""Controllers that send joint angles, most of them in datagrams with a number and a timestamp of the controller."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from daq.protocol.conversation import ConversationStep, Fault, FaultKind, Item, Sample
from daq.protocol.framing import Framer, Message
from daq.protocol.numerals import are_angles
from daq.protocol.streamed import Reaction, StreamedDialect

LIMIT = 4096
"""Several times the longest known message, an RSI text with all possible elements."""


class Datagrams:
    pending = False

    def __init__(self, limit: int = LIMIT) -> None:
        self._limit = limit

    def clear(self) -> None:
        """Ignored: no data is buffered."""

    def feed(self, data: bytes, now_ns: int) -> Sequence[Message | Fault]:
        if len(data) > self._limit:
            return [Fault(FaultKind.GARBLED, now_ns, f"a datagram of {len(data)} bytes, over {self._limit}; ignored")]
        return [Message(data, len(data), now_ns, now_ns)]


class DatagramLines(Datagrams):
    def feed(self, data: bytes, now_ns: int) -> Sequence[Message | Fault]:
        messages: list[Message | Fault] = []
        for datagram in super().feed(data, now_ns):
            if isinstance(datagram, Fault):
                messages.append(datagram)
            else:
                messages += [Message(line, len(line), now_ns, now_ns) for line in datagram.data.splitlines()]
        return messages


_BEHIND = 20
"""Largest reordering by a network, in messages. A larger backward step means a restarted counter."""
_AHEAD = 1_000_000
"""Largest loss in messages, an hour. A larger forward step means a restarted counter."""


class Order:
    """Checks the numbers of successive messages, which increase by `step` and wrap at `modulus`.

    A repeated or overtaken sample is ignored, because a decreasing clock would look like a restarted controller. An
    overtaken sample is first reported as missing and then as late.
    """

    def __init__(self, step: int = 1, modulus: int = 2**32) -> None:
        self._step = step
        self._modulus = modulus
        self._last: int | None = None

    def reset(self) -> None:
        self._last = None

    def admit(self, sample: Sample, number: int) -> tuple[Item, ...]:
        last, at_ns = self._last, sample.last_byte_ns
        if last is None:
            self._last = number
            return (sample,)
        # Number of messages since the last, negative for an earlier message.
        ahead = (number - last) % self._modulus
        signed = ahead if ahead < self._modulus // 2 else ahead - self._modulus
        # Less than a step ahead still counts as the next message: a controller may be faster than the rig file states.
        passed = max(1, round(signed / self._step)) if signed > 0 else signed // self._step
        if -_BEHIND < passed <= 0:
            problem = "came twice" if number == last else f"came after {last}"
            return (Fault(FaultKind.LATE, at_ns, f"datagram {number} {problem}; ignored; check the network"),)
        self._last = number
        if passed == 1:
            return (sample,)
        if not 0 < passed <= _AHEAD:
            detail = f"the controller's counter goes from {last} to {number}: it restarted, and the loss is unknown"
            return Fault(FaultKind.SKIPPED, at_ns, detail), sample
        detail = (
            f"the controller's counter jumps from {last} to {number}; check the network and the load of this computer"
        )
        return Fault(FaultKind.SKIPPED, at_ns, detail, passed - 1), sample


class ClockOrder:
    """Checks the clocks of successive messages without a number. repeats: several may have the same clock."""

    def __init__(self, *, repeats: bool = False) -> None:
        self._least_s = 1e-9 if repeats else 0.0
        self._last_s = math.nan

    def reset(self) -> None:
        self._last_s = math.nan

    def admit(self, sample: Sample, number: int) -> tuple[Item, ...]:
        if self._least_s <= self._last_s - sample.device_time_s < _BEHIND_S:
            detail = f"clock {sample.device_time_s:.6f} s, no later than the one before; ignored"
            remedy = "check the network, and for a second sender"
            return (Fault(FaultKind.LATE, sample.last_byte_ns, f"{detail}; {remedy}"),)
        self._last_s = sample.device_time_s
        return (sample,)


_BEHIND_S = 1.0
"""Smallest backward step of the clock after a restart. Network delays are shorter."""
_MAX_CLOCK_S = 1e11
"""Three thousand years since 1970 or since power-on."""


@dataclass(frozen=True, slots=True)
class Position:
    """Six joint angles, controller clock (nan if unknown), number, and the columns beside the joints."""

    angles_deg: Sequence[float]
    clock_s: float
    number: int = 0
    condition: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class UnusableDatagram:
    kind: FaultKind
    detail: str


class Positions(StreamedDialect):
    def __init__(
        self,
        decode: Callable[[bytes], Position | UnusableDatagram | None],
        check: str,
        order: Order | ClockOrder | None,
        start: bytes = b"",
        frames: Framer | None = None,
    ) -> None:
        """decode: returns None for a message that is ignored. frames: one message per datagram by default."""
        self.frames = frames or Datagrams()
        self.check = check
        self._decode = decode
        self._order = order
        self._start = start

    def start(self) -> bytes:
        return self._start

    def silent(self) -> Reaction:
        if self._order:
            self._order.reset()
        return Reaction(send=self._start)

    def read(self, message: Message) -> Reaction:
        position = self._decode(message.data)
        if position is None:
            return Reaction()
        if isinstance(position, UnusableDatagram):
            return Reaction((message.fault(position.kind, position.detail),))
        if abs(position.clock_s) >= _MAX_CLOCK_S or not are_angles(position.angles_deg):
            detail = f"time {position.clock_s:g} s and angles {tuple(position.angles_deg)}; ignored"
            return Reaction((message.fault(FaultKind.GARBLED, detail),))
        sample = message.sample((*position.angles_deg, *position.condition), position.clock_s)
        return Reaction(self._order.admit(sample, position.number) if self._order else (sample,))


class SteadyRate:
    """Instants of a constant rate from `start_ns` on, by an absolute schedule that does not drift."""

    def __init__(self, rate_hz: float, start_ns: int) -> None:
        self._rate_hz = rate_hz
        self._start_ns = start_ns
        self._count = 0

    @property
    def next_ns(self) -> int:
        return self._start_ns + round(self._count * 1e9 / self._rate_hz)

    def step(self, now_ns: int) -> int | None:
        instant = self.next_ns
        if instant > now_ns:
            return None
        self._count += 1
        return instant

    def due(self, now_ns: int) -> Iterator[int]:
        while (instant := self.step(now_ns)) is not None:
            yield instant


class SteadyDevice(ABC):
    """Device with a constant rate: unprompted with `unasked_hz`, otherwise after a request."""

    IS_STREAM = False
    """True if a step sends all due messages, otherwise a single datagram."""

    def __init__(self, read: Callable[[int], Sequence[float]], unasked_hz: float | None = None) -> None:
        self.sent = 0
        self._read = read
        self._unasked_hz = unasked_hz
        self._connected_ns = 0
        self._pace: SteadyRate | None = None

    def connected(self, now_ns: int) -> ConversationStep:
        self._connected_ns = now_ns
        if self._unasked_hz:
            self._pace = SteadyRate(self._unasked_hz, now_ns)
        return self._step()

    def received(self, data: bytes, now_ns: int) -> ConversationStep:
        return self._step()

    def tick(self, now_ns: int) -> ConversationStep:
        send = b""
        for instant_ns in self._pace.due(now_ns) if self._pace else ():
            send += self._message(instant_ns)
            self.sent += 1
            if not self.IS_STREAM:
                break
        return self._step(send)

    def _step(self, send: bytes = b"") -> ConversationStep:
        return ConversationStep(send, wake_ns=self._pace.next_ns if self._pace else None)

    @abstractmethod
    def _message(self, instant_ns: int) -> bytes:
        """Message of this instant."""


_FIRST = 25
"""Steps used to measure the period, a fifth of a second at 125 Hz: at least one of them contains no loss."""
_MORE = 1.5
"""Multiple of the period above which a step contains losses."""


class SteadySteps:
    """Checks the stamps of successive packets.

    A controller may send at a lower rate than requested: at 125 Hz instead of 500 Hz nothing is missing. The period is
    the requested one once it was observed, otherwise the smallest of the first steps.
    """

    def __init__(self, rate_hz: float) -> None:
        self._asked_s = 1 / rate_hz
        self._period_s = math.nan
        self._last_s = math.nan
        self._unjudged: list[tuple[float, float]] = []

    def check_stamp(self, clock_s: float, at_ns: int) -> list[Fault]:
        before_s, self._last_s = self._last_s, clock_s
        if not clock_s > before_s:
            return []
        self._unjudged.append((before_s, clock_s))
        faults = list[Fault]()
        if math.isnan(self._period_s):  # measure the period once there are enough steps
            least_s = min(after_s - before_s for before_s, after_s in self._unjudged)
            if least_s < _MORE * self._asked_s:
                self._period_s = self._asked_s
            elif len(self._unjudged) < _FIRST:
                return []
            else:
                self._period_s = round(least_s / self._asked_s) * self._asked_s
                sent_hz, asked_hz = 1 / self._period_s, 1 / self._asked_s
                rates = f"the controller sends {sent_hz:g} packets a second instead of {asked_hz:g}"
                faults.append(Fault(FaultKind.DOUBTFUL, at_ns, f"{rates}; set rate_hz: {sent_hz:g}"))
        steps, self._unjudged = self._unjudged, []
        for before_s, after_s in steps:
            periods = (after_s - before_s) / self._period_s
            if periods > _MORE:
                detail = (
                    f"controller time jumps from {before_s:.3f} s to {after_s:.3f} s; reduce rate_hz if this recurs"
                )
                faults.append(Fault(FaultKind.SKIPPED, at_ns, detail, round(periods) - 1))
        return faults
