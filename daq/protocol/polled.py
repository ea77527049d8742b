"""Requests and answers: one request on the line at a time, the next one as soon as it is answered and due.

An answer must never be credited to a later request. Serial answers carry no number, so whenever it is unclear
whose an answer would be, nothing is asked: the line is *drained*, that is, whatever comes is discarded until
nothing has come for `timeout_s`. So it is

- at connect, where an answer to someone's earlier request may still be on its way,
- after a time-out (Fault SILENT), whose answer may still come (Fault LATE, with the count discarded),
- after bytes that make no sense, since the real answer may be among them,
- when more than the answer came.

It also is where nothing is asked because a given `rate_hz` allows no further request yet (a request that is made a
little late puts off none of those after it, or a busy computer would never reach that rate), and now and then to stir
the line (`Stirring`). On a line that it shares an instrument is asked when its turn comes, and all that
comes meanwhile is somebody else's (`daq.protocol.bus`).

An answer later than twice `timeout_s` can still slip through where the protocol has neither a number nor a length
to distinguish them by (`daq.protocol.modbus`): make `timeout_s` at least half the slowest answer of the instrument.
After an error answer the line rests for `PAUSE_NS`, for an instrument that refuses does so at once.

Now and then the line rests, so that an adapter which holds bytes back does not fall into step with the requests. FTDI's
latency timer is 16 ms. Where each request follows the answer before at once, its answers all wait alike; then no answer
of a run comes as quickly as the instrument gives it, and it is unknown when it was latched. So after `STIR` requests
the line rests for up to `STIR_NS`, each time for another time: half a second (`STIR_EVERY_NS`) apart at the least,
since it makes a hole in the readings of a quick instrument.

An instrument can be asked by a modem line as well: DTR goes off for some time, and it sends a reading. Cables of which
the instrument cannot hear anything are made so. The exchange is that of a request and its answer (`Polled`); here its
request becomes the line. DTR is on between two requests for as long as it was off.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum, auto
from typing import Protocol

from daq.protocol.conversation import NO_TIME, Bursts, Fault, FaultKind, Item, Step, has_fault
from daq.protocol.framing import Framer, Message
from daq.protocol.numerals import PassesShapes

STIR = 50
STIR_NS = 17_000_000
STIR_EVERY_NS = 500_000_000
_GOLDEN = 0.6180339887498949
"""Multiples of it, less their whole part, fill the range from 0 to 1 evenly, however many there are."""


class Stirring:
    """Counts the requests on a line, and says when it rests."""

    def __init__(self) -> None:
        self._requests = self._stirs = 0
        self._stirred_ns = 0

    def begin(self, now_ns: int) -> None:
        """Note that the link has just opened."""
        self._stirred_ns = now_ns

    def count(self) -> None:
        """Note a request."""
        self._requests += 1

    def rest_ns(self, now_ns: int) -> int:
        """Return how long the line rests after an answer; mostly 0."""
        if self._requests < STIR or now_ns < self._stirred_ns + STIR_EVERY_NS:
            return 0
        self._requests, self._stirred_ns = 0, now_ns
        self._stirs += 1
        return round(self._stirs * _GOLDEN % 1.0 * STIR_NS)


PAUSE_NS = 100_000_000
_BABBLE = 4
"""Time-outs that a drain may last before it is reported and the instrument is asked again to be quiet."""


_ECHOED = 3
"""Bytes of a request that are hardly the beginning of an answer."""


def echoed_part(sent: bytes, heard: bytes) -> int:
    """Return how many bytes of a request came back, where a part of it did: without its first bytes, which an adapter
    misses that turns round late, or without its last, which the answer has cut off. 0 where none did."""
    for skipped in range(len(sent) - _ECHOED + 1):
        tail = sent[skipped:]
        length = next(
            (k for k, (a, b) in enumerate(zip(tail, heard, strict=False)) if a != b), min(len(tail), len(heard))
        )
        if length >= _ECHOED and (skipped == 0 or length == len(tail)):
            return length
    return 0


class Then(Enum):
    """What a message means for the exchange."""

    ASK = auto()
    """The message was the answer."""
    PAUSE = auto()
    """The message was the answer, and a refusal."""
    WAIT = auto()
    """The message was not the answer, which may still come."""
    DRAIN = auto()
    """The message may or may not be the answer."""


@dataclass(frozen=True, slots=True)
class Reply:
    """The meaning of a message: its items, and what follows for the exchange.

    No items: a step on the way to a reading, which neither begins nor ends a run of faults.
    """

    items: tuple[Item, ...]
    then: Then = Then.ASK


class PolledDialect(Protocol):
    """What one instrument adds to the exchange of requests and answers."""

    @property
    def frames(self) -> Framer:
        """The framer that cuts its messages."""

    reset: bytes
    """The bytes that make the instrument quiet; sent at the beginning of a drain in which no answer is expected."""
    check: str
    """What to look at when it is silent."""
    babble: str
    """What to look at when its line will not go quiet."""

    def request(self) -> bytes:
        """Return the next request."""

    def read(self, message: Message, requested_ns: int) -> Reply:
        """Return the meaning of a message as an answer to the request of that time."""


class Polled(PassesShapes):
    """The host's side of an instrument that answers requests."""

    def __init__(
        self, dialect: PolledDialect, timeout_s: float, rate_hz: float = math.inf, *, shared: bool = False
    ) -> None:
        """shared: whether others are asked on the line in between; then `tick` is what lets it ask."""
        self._asked = self._dialect = dialect
        self._shared = shared
        self._period_ns = round(1e9 / rate_hz)
        self._timeout_s = timeout_s
        self._timeout_ns = round(timeout_s * 1e9)
        self._bursts = Bursts()
        self._requested_ns = NO_TIME
        self._stirring = Stirring()
        self._due_ns = 0
        """The earliest time of the next request."""
        self._wake_ns = 0
        self._quiet_ns = self._timeout_ns
        self._discarded = 0
        self._reporting = False
        self._babble_ns = 0
        self._sent = self._heard = b""
        """The request on the line, and the first that came after it, as much as an echo of it would be."""

    @property
    def asking(self) -> bool:
        """Whether a request is on the line."""
        return self._requested_ns != NO_TIME

    def connected(self, now_ns: int) -> Step:
        self._stirring.begin(now_ns)
        return self._drain([], now_ns, send=self._dialect.reset)

    def received(self, data: bytes, now_ns: int) -> Step:
        self._heard = (self._heard + data)[: len(self._sent)]
        messages = self._dialect.frames.feed(data, now_ns)
        if not self.asking:
            return self._discard(len(messages), now_ns)
        items: list[Item] = []
        for position, message in enumerate(messages, 1):
            reply = self._read(message)
            if reply.items:
                items += self._bursts.merge(reply.items, now_ns)
            if reply.then is not Then.WAIT:
                return self._go_on(reply.then, items, len(messages) - position, now_ns)
        if now_ns >= self._wake_ns:
            return self._give_up(items, now_ns)
        return Step(items=tuple(items), wake_ns=self._wake_ns)

    def tick(self, now_ns: int) -> Step:
        if now_ns < self._wake_ns:
            return Step(wake_ns=self._wake_ns)
        if self.asking:
            return self._give_up([], now_ns)
        items = self._late(now_ns)
        self._dialect.frames.clear()
        return self._ask(items, now_ns)

    def lost(self, now_ns: int) -> tuple[Item, ...]:
        late = [] if self.asking else self._late(now_ns)
        return (*self._bursts.end(), *late)

    def _read(self, message: Message | Fault) -> Reply:
        if isinstance(message, Fault):
            return Reply((self._explained(message),), Then.DRAIN)
        reply = self._dialect.read(message, self._requested_ns)
        if not has_fault(reply.items):
            return reply  # a reading, nearly always
        return replace(reply, items=tuple(map(self._explained, reply.items)))

    def _explained(self, item: Item) -> Item:
        """A fault that bytes make no sense says so where they are a part of our own request."""
        if not isinstance(item, Fault) or item.kind is not FaultKind.GARBLED:
            return item
        if not (part := echoed_part(self._sent, self._heard)):
            return item
        echo = f"it begins with {part} of the {len(self._sent)} bytes of our own request, so the adapter echoes"
        return replace(item, detail=f"{item.detail}; {echo}: switch off the echo of the RS-485 adapter")

    def _go_on(self, then: Then, items: list[Item], surplus: int, now_ns: int) -> Step:
        if then is Then.DRAIN:
            return self._drain(items, now_ns)
        if surplus or self._dialect.frames.pending:
            return self._drain(items, now_ns, discarded=surplus, reporting=True)
        if then is Then.PAUSE:
            return self._drain(items, now_ns, quiet_ns=PAUSE_NS, reporting=True)
        if not self._shared:
            self._due_ns = max(self._due_ns, now_ns + self._stirring.rest_ns(now_ns))
        if self._shared or self._due_ns > now_ns:
            return self._drain(items, now_ns, quiet_ns=max(0, self._due_ns - now_ns), reporting=True)
        return self._ask(items, now_ns)

    def _ask(self, items: Sequence[Item], now_ns: int) -> Step:
        self._requested_ns = now_ns
        self._stirring.count()
        late = now_ns - self._due_ns > self._period_ns
        self._due_ns = (now_ns if late else self._due_ns) + self._period_ns
        self._wake_ns = now_ns + self._timeout_ns
        self._sent, self._heard = self._dialect.request(), b""
        return Step(self._sent, tuple(items), self._wake_ns)

    def _give_up(self, items: list[Item], now_ns: int) -> Step:
        detail = f"no answer within {self._timeout_s:g} s; {self._dialect.check}"
        silent = Fault(FaultKind.SILENT, now_ns, detail)
        return self._drain([*items, *self._bursts.end(), silent], now_ns, reporting=True)

    def _drain(
        self,
        items: Sequence[Item],
        now_ns: int,
        *,
        send: bytes = b"",
        quiet_ns: int | None = None,
        discarded: int = 0,
        reporting: bool = False,
    ) -> Step:
        """Request nothing until the line has been quiet; `reporting`: what comes meanwhile is reported."""
        self._requested_ns = NO_TIME
        self._quiet_ns = self._timeout_ns if quiet_ns is None else quiet_ns
        self._wake_ns = now_ns + self._quiet_ns
        self._babble_ns = now_ns + _BABBLE * self._timeout_ns
        self._discarded = discarded
        self._reporting = reporting
        return Step(send, tuple(items), self._wake_ns)

    def _discard(self, messages: int, now_ns: int) -> Step:
        self._discarded += messages
        self._quiet_ns = self._timeout_ns
        self._wake_ns = now_ns + self._quiet_ns
        if now_ns < self._babble_ns:
            return Step(wake_ns=self._wake_ns)
        detail = f"the line will not go quiet, so nothing can be asked; {self._dialect.babble}"
        fault = Fault(FaultKind.LATE, now_ns, detail, max(1, self._discarded))
        return self._drain([fault], now_ns, send=self._dialect.reset)

    def _late(self, now_ns: int) -> list[Item]:
        """Return the fault for what the drain discarded, including an incomplete message."""
        count = self._discarded + self._dialect.frames.pending
        if not (self._reporting and count):
            return []
        detail = "a message came while no answer was expected and was ignored; if this recurs, increase timeout_s"
        return [Fault(FaultKind.LATE, now_ns, detail, count)]


class AskedByLine(PassesShapes):
    """The host's side. exchange: one that shares its line, so that it asks when it is let."""

    def __init__(self, exchange: Polled, off_ns: int) -> None:
        self._asked = self._exchange = exchange
        self._off_ns = off_ns
        self._wake_ns = self._free_ns = 0
        """When the exchange is due, and when DTR may go off again."""
        self._on_ns: int | None = None
        """When DTR goes on again; None while it is."""

    def connected(self, now_ns: int) -> Step:
        return self._after(self._exchange.connected(now_ns), now_ns)

    def received(self, data: bytes, now_ns: int) -> Step:
        return self._after(self._exchange.received(data, now_ns), now_ns)

    def tick(self, now_ns: int) -> Step:
        if self._on_ns is not None and now_ns >= self._on_ns:
            self._on_ns = None
            return Step(wake_ns=self._due_ns(), dtr=True)
        if not self._exchange.asking and now_ns < self._free_ns:
            return Step(wake_ns=self._due_ns())
        return self._after(self._exchange.tick(now_ns), now_ns)

    def lost(self, now_ns: int) -> tuple[Item, ...]:
        return self._exchange.lost(now_ns)

    def _after(self, step: Step, now_ns: int) -> Step:
        self._wake_ns = now_ns if step.wake_ns is None else step.wake_ns
        if not step.send:
            return Step(items=step.items, wake_ns=self._due_ns())
        self._on_ns, self._free_ns = now_ns + self._off_ns, now_ns + 2 * self._off_ns
        return Step(items=step.items, wake_ns=self._due_ns(), dtr=False)

    def _due_ns(self) -> int:
        due_ns = self._wake_ns if self._exchange.asking else max(self._wake_ns, self._free_ns)
        return due_ns if self._on_ns is None else min(due_ns, self._on_ns)
