"""A controller that sends its joint angles by datagrams, each with a number and a stamp of its own clock.

What the interfaces differ in is how a datagram is taken apart, and what makes the controller send. What is read at once
is one message, and nothing ever continues in the next; the other way it is as plain: what a step sends is one datagram.
`DatagramLines` is for texts: a datagram holds whole lines, the last of which needs no end. Both are framers like those
of `daq.protocol.framing`, so that a conversation need not know what carried its bytes.

Lost, doubled and overtaken datagrams show by their numbers. A sample that comes after a later one, or twice, is ignored
and reported as LATE: its time has passed, and a clock that runs backwards would look like a controller that was started
again. What is missing is a SKIPPED fault with the count; so a sample that was overtaken is reported as missing first
and as late when it comes.

A device of constant rate (`SteadyDevice`) speaks by an absolute schedule: no period drifts or is lost (`Pace`).

A controller that was asked for a rate may keep to a lower one: one of 125 Hz that is asked for 500 sends all it has,
and nothing of it is missing. So a stamp is compared with the step that the controller makes itself: the asked one as
soon as it was seen once, else the least of the first steps.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

from daq.protocol.conversation import NO_TIME, Fault, FaultKind, Item, Sample, Step
from daq.protocol.framing import Message
from daq.protocol.numerals import are_angles
from daq.protocol.streamed import Reaction

LIMIT = 4096
"""Several times the longest message known here, an RSI text with every element that it can carry."""


class Datagrams:
    """Treats each piece as one message; one longer than `limit` bytes is a GARBLED fault."""

    pending = False

    def __init__(self, limit: int = LIMIT) -> None:
        self._limit = limit

    def clear(self) -> None:
        """Do nothing, since nothing is ever held."""

    def feed(self, data: bytes, now_ns: int) -> Sequence[Message | Fault]:
        if len(data) > self._limit:
            return [Fault(FaultKind.GARBLED, now_ns, f"a datagram of {len(data)} bytes, over {self._limit}; left out")]
        return [Message(data, len(data), now_ns, now_ns)]


class DatagramLines(Datagrams):
    """Treats each line of a datagram as one message; the datagrams as `Datagrams` does."""

    def feed(self, data: bytes, now_ns: int) -> Sequence[Message | Fault]:
        messages: list[Message | Fault] = []
        for datagram in super().feed(data, now_ns):
            if isinstance(datagram, Fault):
                messages.append(datagram)
            else:
                messages += [Message(line, len(line), now_ns, now_ns) for line in datagram.data.splitlines()]
        return messages


_BEHIND = 20
"""Messages that a network may hold one back by. Further back, the counter restarted."""
_AHEAD = 1_000_000
"""Messages that can be lost in a row: an hour. Further ahead, the counter restarted."""


class Order:
    """Checks the numbers of successive messages, which grow by `step` and wrap at `modulus`."""

    def __init__(self, step: int = 1, modulus: int = 2**32) -> None:
        self._step = step
        self._modulus = modulus
        self._last: int | None = None

    def forget(self) -> None:
        """Forget the last number, so that the next message continues nothing."""
        self._last = None

    def admit(self, sample: Sample, number: int) -> tuple[Item, ...]:
        """Return the sample with this number, unless it came too late, and the faults that its number shows."""
        last, at_ns = self._last, sample.last_byte_ns
        if last is None:
            self._last = number
            return (sample,)
        # Messages from the last one to this, negative for an earlier one.
        ahead = (number - last) % self._modulus
        signed = ahead if ahead < self._modulus // 2 else ahead - self._modulus
        # Less than a step ahead is the next all the same: a controller may be quicker than the rig file says.
        passed = max(1, round(signed / self._step)) if signed > 0 else signed // self._step
        if -_BEHIND < passed <= 0:
            problem = "came twice" if number == last else f"came after {last}"
            return (Fault(FaultKind.LATE, at_ns, f"datagram {number} {problem}; left out; check the network"),)
        self._last = number
        if passed == 1:
            return (sample,)
        if not 0 < passed <= _AHEAD:
            detail = f"the controller's counter goes from {last} to {number}: it restarted, and the loss is unknown"
            return Fault(FaultKind.SKIPPED, at_ns, detail), sample
        detail = f"the controller's counter goes from {last} to {number}; check the network and the host's load"
        return Fault(FaultKind.SKIPPED, at_ns, detail, passed - 1), sample


_MAX_CLOCK_S = 1e11
"""A later stamp is invalid: three thousand years, whether since 1970 or since the controller was switched on."""


@dataclass(frozen=True, slots=True)
class Position:
    """The position in one datagram: six joint angles (deg), the controller's clock (s) and the datagram's number, and
    the columns of the robot's condition that the interface has."""

    angles_deg: tuple[float, ...]
    clock_s: float
    number: int
    condition: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class Refused:
    """The reason why a datagram holds no position, in words."""

    kind: FaultKind
    detail: str


class Positions:
    """Receives positions in datagrams; `start` is sent at first, and again whenever the controller is silent."""

    def __init__(
        self, decode: Callable[[bytes], Position | Refused], check: str, order: Order, start: bytes = b""
    ) -> None:
        self.frames = Datagrams()
        self.check = check
        self._decode = decode
        self._order = order
        self._start = start

    def start(self) -> bytes:
        return self._start

    def silent(self) -> Reaction:
        self._order.forget()
        return Reaction(send=self._start)

    def read(self, message: Message | Fault) -> Reaction:
        if isinstance(message, Fault):
            return Reaction((message,))
        position, at_ns = self._decode(message.data), message.last_byte_ns
        if isinstance(position, Position) and not (
            0 <= position.clock_s < _MAX_CLOCK_S and are_angles(position.angles_deg)
        ):
            detail = f"time {position.clock_s:g} s and angles {position.angles_deg}; left out"
            position = Refused(FaultKind.GARBLED, detail)
        if isinstance(position, Refused):
            detail = f"datagram of {message.size} bytes: {position.detail}"
            return Reaction((Fault(position.kind, at_ns, detail),))
        stamps = (NO_TIME, message.first_byte_ns, at_ns)
        values = (*position.angles_deg, *position.condition)
        sample = Sample(values, *stamps, message.size, position.clock_s)
        return Reaction(self._order.admit(sample, position.number))


class Pace:
    """Gives the instants of a steady rate from `start_ns` on."""

    def __init__(self, rate_hz: float, start_ns: int) -> None:
        self._rate_hz = rate_hz
        self._start_ns = start_ns
        self._count = 0

    @property
    def next_ns(self) -> int:
        """The next instant that was not given yet."""
        return self._start_ns + round(self._count * 1e9 / self._rate_hz)

    def step(self, now_ns: int) -> int | None:
        """Return the next instant that was not given before; None if it has not come yet."""
        instant = self.next_ns
        if instant > now_ns:
            return None
        self._count += 1
        return instant

    def due(self, now_ns: int) -> Iterator[int]:
        """Return every instant up to now that was not given before."""
        while (instant := self.step(now_ns)) is not None:
            yield instant


class SteadyDevice(ABC):
    """A device that sends what it reads at a steady rate: from when its link opens if `unasked_hz` says how often, else
    while a request has set its pace."""

    IS_STREAM = False
    """Whether a step sends all messages that are due. Else it sends one, as a datagram is, and if that was late the
    next follows at once."""

    def __init__(self, read: Callable[[int], Sequence[float]], unasked_hz: float | None = None) -> None:
        self.sent = 0
        self._read = read
        self._unasked_hz = unasked_hz
        self._connected_ns = 0
        self._pace: Pace | None = None

    def connected(self, now_ns: int) -> Step:
        self._connected_ns = now_ns
        if self._unasked_hz:
            self._pace = Pace(self._unasked_hz, now_ns)
        return self._step()

    def received(self, data: bytes, now_ns: int) -> Step:
        return self._step()

    def tick(self, now_ns: int) -> Step:
        send = b""
        for instant_ns in islice(self._pace.due(now_ns) if self._pace else (), None if self.IS_STREAM else 1):
            send += self._message(instant_ns)
            self.sent += 1
        return self._step(send)

    def _step(self, send: bytes = b"") -> Step:
        return Step(send, wake_ns=self._pace.next_ns if self._pace else None)

    @abstractmethod
    def _message(self, instant_ns: int) -> bytes:
        """What it sends of this instant."""


_FIRST = 25
"""Steps from which the rate is taken, a fifth of a second at 125 Hz: packets are not skipped at each of them."""
_MORE = 1.5
"""Periods from which a step is longer than one."""


class SteadySteps:
    """Watches the stamps of successive packets."""

    def __init__(self, rate_hz: float) -> None:
        self._asked_s = 1 / rate_hz
        self._period_s = math.nan
        self._last_s = math.nan
        self._unjudged: list[tuple[float, float]] = []
        """Steps from a stamp to the next, while the period is not known."""

    def missing(self, clock_s: float, at_ns: int) -> list[Fault]:
        """Take the next stamp; return faults for packets missing before it, and for a rate other than the asked one."""
        before_s, self._last_s = self._last_s, clock_s
        if not clock_s > before_s:
            return []
        self._unjudged.append((before_s, clock_s))
        faults = list[Fault]()
        if math.isnan(self._period_s):  # take the period from the steps so far, if they are enough
            least_s = min(after_s - before_s for before_s, after_s in self._unjudged)
            if least_s < _MORE * self._asked_s:
                self._period_s = self._asked_s
            elif len(self._unjudged) < _FIRST:
                return []
            else:
                self._period_s = round(least_s / self._asked_s) * self._asked_s
                sent_hz, asked_hz = 1 / self._period_s, 1 / self._asked_s
                rates = f"the controller sends {sent_hz:g} packets a second, not {asked_hz:g}"
                faults.append(Fault(FaultKind.DOUBTFUL, at_ns, f"{rates}; write rate_hz: {sent_hz:g}"))
        steps, self._unjudged = self._unjudged, []
        for before_s, after_s in steps:
            periods = (after_s - before_s) / self._period_s
            if periods > _MORE:
                detail = f"controller time goes from {before_s:.3f} s to {after_s:.3f} s; lower rate_hz if this recurs"
                faults.append(Fault(FaultKind.SKIPPED, at_ns, detail, round(periods) - 1))
        return faults
