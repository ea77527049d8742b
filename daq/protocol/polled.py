"""Exchange of requests and answers. A request is sent when it is due and the previous one is answered.

An answer must never be assigned to a later request. Serial answers contain no number, so in ambiguous situations the
line is *drained*: received data is discarded until the line has been silent for `timeout_s`. An answer later than twice
`timeout_s` can still be misassigned if the protocol offers neither number nor length (`daq.protocol.modbus`): set
`timeout_s` to at least half of the slowest answer time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum, auto
from typing import Protocol

from daq.protocol.conversation import NO_TIME, Bursts, ConversationStep, Fault, FaultKind, Item
from daq.protocol.framing import Framer, Message
from daq.protocol.numerals import NumberFormat

STIR, STIR_NS, STIR_EVERY_NS = 50, 17_000_000, 500_000_000
"""Requests before a pause, longest pause, and shortest time between pauses, each of which leaves a gap."""
_GOLDEN = 0.6180339887498949
"""Golden ratio: the fractional parts of its multiples fill the range from 0 to 1 evenly, for any count."""


class Stirring:
    """Occasional pauses of varying length, so that a buffering adapter does not synchronise with the requests.

    The latency timer of FTDI is 16 ms. If each request follows the previous answer immediately, all answers are delayed
    equally, no answer is as fast as the instrument allows, and the latching time is unknown.
    """

    def __init__(self) -> None:
        self.requests = self.since_ns = self._stirs = 0
        """Requests since the last pause, and its time."""

    def rest_ns(self, now_ns: int) -> int:
        if self.requests < STIR or now_ns < self.since_ns + STIR_EVERY_NS:
            return 0
        self.requests, self.since_ns = 0, now_ns
        self._stirs += 1
        return round(self._stirs * _GOLDEN % 1.0 * STIR_NS)


PAUSE_NS = 100_000_000
"""Pause after a refusal, which an instrument sends immediately."""
_BABBLE = 4
"""Time-outs after which a continuing drain is reported and the instrument is reset."""


class Then(Enum):
    ASK = auto()
    """The message was the answer."""
    PAUSE = auto()
    WAIT = auto()
    """The message was not the answer. The answer may still arrive."""
    DRAIN = auto()
    """It is unclear whether the message was the answer."""


@dataclass(frozen=True, slots=True)
class Reply:
    """Items of a message, and the effect on the exchange.

    Empty items: an intermediate step, which neither starts nor ends a series of faults.
    """

    items: tuple[Item, ...]
    then: Then = Then.ASK


class PolledDialect(Protocol):
    @property
    def frames(self) -> Framer:
        """Framer of the messages."""

    @property
    def formats(self) -> Sequence[NumberFormat]:
        """Formats of printed numbers, one per gauge; none for binary values."""

    reset: bytes
    """Bytes that silence the instrument, sent at the start of a drain if no answer is expected."""
    check: str
    babble: str
    """Advice for a line that does not become silent."""

    def request(self) -> bytes:
        """Next request."""

    def read(self, message: Message, requested_ns: int) -> Reply:
        """Interpret a message as an answer to the request of this time."""


class Polled:
    def __init__(
        self, dialect: PolledDialect, timeout_s: float, rate_hz: float = math.inf, *, shared: bool = False
    ) -> None:
        """shared: other instruments are polled in between, and `tick` gives the turn."""
        self._dialect, self.formats = dialect, dialect.formats
        self._shared = shared
        self._period_ns = round(1e9 / rate_hz)
        self._timeout_s = timeout_s
        self._timeout_ns = round(timeout_s * 1e9)
        self._bursts = Bursts()
        self._requested_ns = NO_TIME
        self._stirring = Stirring()
        self._due_ns = 0
        self._wake_ns = 0
        self._quiet_ns = self._timeout_ns
        self._discarded = 0
        self._reporting = False
        self._babble_ns = 0

    @property
    def asking(self) -> bool:
        return self._requested_ns != NO_TIME

    def connected(self, now_ns: int) -> ConversationStep:
        self._stirring.since_ns = now_ns
        return self._drain([], now_ns, send=self._dialect.reset)

    def received(self, data: bytes, now_ns: int) -> ConversationStep:
        messages = self._dialect.frames.feed(data, now_ns)
        if not self.asking:
            self._discarded += len(messages)
            self._quiet_ns = self._timeout_ns
            self._wake_ns = now_ns + self._quiet_ns
            if now_ns < self._babble_ns:
                return ConversationStep(wake_ns=self._wake_ns)
            detail = f"the line is never quiet, so requests cannot be sent; {self._dialect.babble}"
            fault = Fault(FaultKind.LATE, now_ns, detail, max(1, self._discarded))
            return self._drain([fault], now_ns, send=self._dialect.reset)
        items: list[Item] = []
        for position, message in enumerate(messages, 1):
            if isinstance(message, Fault):
                reply = Reply((message,), Then.DRAIN)
            else:
                reply = self._dialect.read(message, self._requested_ns)
            if reply.items:
                items += self._bursts.merge(reply.items, now_ns)
            if reply.then is not Then.WAIT:
                return self._go_on(reply.then, items, len(messages) - position, now_ns)
        if now_ns >= self._wake_ns:
            return self._give_up(items, now_ns)
        return ConversationStep(items=tuple(items), wake_ns=self._wake_ns)

    def tick(self, now_ns: int) -> ConversationStep:
        if now_ns < self._wake_ns:
            return ConversationStep(wake_ns=self._wake_ns)
        if self.asking:
            return self._give_up([], now_ns)
        items = self._late(now_ns)
        self._dialect.frames.clear()
        return self._ask(items, now_ns)

    def handle_link_loss(self, now_ns: int) -> tuple[Item, ...]:
        late = [] if self.asking else self._late(now_ns)
        return (*self._bursts.end(), *late)

    def _go_on(self, then: Then, items: list[Item], surplus: int, now_ns: int) -> ConversationStep:
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

    def _ask(self, items: Sequence[Item], now_ns: int) -> ConversationStep:
        self._requested_ns = now_ns
        self._stirring.requests += 1
        # A slightly late request does not delay later ones: otherwise a busy computer could not reach the rate.
        late = now_ns - self._due_ns > self._period_ns
        self._due_ns = (now_ns if late else self._due_ns) + self._period_ns
        self._wake_ns = now_ns + self._timeout_ns
        return ConversationStep(self._dialect.request(), tuple(items), self._wake_ns)

    def _give_up(self, items: list[Item], now_ns: int) -> ConversationStep:
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
    ) -> ConversationStep:
        """Wait for a silent line before the next request. reporting: report the data received meanwhile."""
        self._requested_ns = NO_TIME
        self._quiet_ns = self._timeout_ns if quiet_ns is None else quiet_ns
        self._wake_ns = now_ns + self._quiet_ns
        self._babble_ns = now_ns + _BABBLE * self._timeout_ns
        self._discarded = discarded
        self._reporting = reporting
        return ConversationStep(send, tuple(items), self._wake_ns)

    def _late(self, now_ns: int) -> list[Item]:
        count = self._discarded + self._dialect.frames.pending
        if not (self._reporting and count):
            return []
        detail = "an unexpected message was ignored; if this recurs, increase timeout_s"
        return [Fault(FaultKind.LATE, now_ns, detail, count)]


class AskedByLine:
    """Host side of an instrument that sends a reading when DTR goes off briefly: a request is a pulse of the line.

    exchange: in shared mode.
    """

    def __init__(self, exchange: Polled, off_ns: int) -> None:
        self._exchange, self.formats = exchange, exchange.formats
        self._off_ns = off_ns
        self._wake_ns = self._free_ns = 0
        self._on_ns: int | None = None
        """Time to switch DTR on; None while it is on."""

    def connected(self, now_ns: int) -> ConversationStep:
        return self._after(self._exchange.connected(now_ns), now_ns)

    def received(self, data: bytes, now_ns: int) -> ConversationStep:
        return self._after(self._exchange.received(data, now_ns), now_ns)

    def tick(self, now_ns: int) -> ConversationStep:
        if self._on_ns is not None and now_ns >= self._on_ns:
            self._on_ns = None
            return ConversationStep(wake_ns=self._due_ns(), dtr=True)
        if not self._exchange.asking and now_ns < self._free_ns:
            return ConversationStep(wake_ns=self._due_ns())
        return self._after(self._exchange.tick(now_ns), now_ns)

    def handle_link_loss(self, now_ns: int) -> tuple[Item, ...]:
        return self._exchange.handle_link_loss(now_ns)

    def _after(self, step: ConversationStep, now_ns: int) -> ConversationStep:
        self._wake_ns = now_ns if step.wake_ns is None else step.wake_ns
        if not step.send:
            return ConversationStep(items=step.items, wake_ns=self._due_ns())
        self._on_ns, self._free_ns = now_ns + self._off_ns, now_ns + 2 * self._off_ns
        return ConversationStep(items=step.items, wake_ns=self._due_ns(), dtr=False)

    def _due_ns(self) -> int:
        due_ns = self._wake_ns if self._exchange.asking else max(self._wake_ns, self._free_ns)
        return due_ns if self._on_ns is None else min(due_ns, self._on_ns)
