"""Receiving from a peer that sends by itself once it has been started.

Each message is read as it comes. A silence of `timeout_s` is reported (Fault SILENT), once per `timeout_s`, and
the dialect says what to do about it. Bytes without a message in them do not end a silence.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from daq.protocol.conversation import Arrival, Bursts, Fault, FaultKind, Item, Samples, Step
from daq.protocol.framing import Framer, Message
from daq.protocol.numerals import PassesShapes


@dataclass(frozen=True, slots=True)
class Reaction:
    """The meaning of a message and what to send for it; `hang_up`: close the link, which brings nothing more."""

    items: tuple[Item, ...] = ()
    send: bytes = b""
    hang_up: bool = False


class StreamedDialect(Protocol):
    """What one peer adds to sending by itself."""

    @property
    def frames(self) -> Framer:
        """The framer that cuts its messages."""

    check: str
    """What to look at when it is silent."""

    def start(self) -> bytes:
        """Return the bytes that start it."""

    def read(self, message: Message | Fault) -> Reaction:
        """Return the meaning of a message, or of a place where the stream could not be cut."""

    def silent(self) -> Reaction:
        """Return what to do about a silence."""


class Streamed(PassesShapes):
    """The host's side of a peer that sends by itself."""

    def __init__(self, dialect: StreamedDialect, timeout_s: float) -> None:
        self._asked = self._dialect = dialect
        self._timeout_s = timeout_s
        self._timeout_ns = round(timeout_s * 1e9)
        self._bursts = Bursts()
        self._wake_ns = 0
        self._over = False

    def connected(self, now_ns: int) -> Step:
        self._wake_ns = now_ns + self._timeout_ns
        return Step(self._dialect.start(), wake_ns=self._wake_ns)

    def received(self, data: bytes, now_ns: int) -> Step:
        send, items = b"", list[Item]()
        if not self._over:
            for message in self._dialect.frames.feed(data, now_ns):
                reaction = self._dialect.read(message)
                items += self._bursts.merge(reaction.items, now_ns)
                send += reaction.send
                if not isinstance(message, Fault):
                    self._wake_ns = now_ns + self._timeout_ns
                if reaction.hang_up:
                    return self._finish(send, items)
        return self._watch(send, items, now_ns)

    def tick(self, now_ns: int) -> Step:
        return self._watch(b"", [], now_ns)

    def lost(self, now_ns: int) -> tuple[Item, ...]:
        return tuple(self._bursts.end())

    def _watch(self, send: bytes, items: list[Item], now_ns: int) -> Step:
        if self._over:
            return Step(hang_up=True)
        if now_ns >= self._wake_ns:
            detail = f"nothing for {self._timeout_s:g} s; {self._dialect.check}"
            items += [*self._bursts.end(), Fault(FaultKind.SILENT, now_ns, detail)]
            self._wake_ns = now_ns + self._timeout_ns
            reaction = self._dialect.silent()
            send += reaction.send
            if reaction.hang_up:
                return self._finish(send, items)
        return Step(send, tuple(items), self._wake_ns)

    def _finish(self, send: bytes, items: list[Item]) -> Step:
        self._over = True
        return Step(send, (*items, *self._bursts.end()), hang_up=True)


_FIRST_SLOWLY_BYTES = 48
"""Bytes that are read one by one where arrays cannot, before they are tried again: some values. Twice as many each
time, so that the tries on a garbled stream stay few."""


class QuickDialect(StreamedDialect, Protocol):
    """What one peer adds that sends thousands of messages a second."""

    def read_run(self, arrivals: Sequence[Arrival]) -> tuple[Samples, Sequence[Arrival]]:
        """Return the plain readings that the arrivals begin with, up to anything else; and the arrivals after them."""


class QuicklyStreamed(Streamed):
    """The host's side of a peer that sends thousands of messages a second: plain readings are read by arrays."""

    gather_ns = 100_000_000
    """Nothing is stamped while messages are read, some 0.3 ms however many. So seldom, less than one stamp of a hundred
    meets that; and it is sooner than the recorder comes round."""

    def __init__(self, dialect: QuickDialect, timeout_s: float) -> None:
        super().__init__(dialect, timeout_s)
        self._quick = dialect

    def received_all(self, arrivals: Sequence[Arrival]) -> Step:
        if self._over:
            return Step(hang_up=True)
        send, items, remaining, slowly = b"", list[Item](), arrivals, _FIRST_SLOWLY_BYTES
        while remaining:
            samples, remaining = self._quick.read_run(remaining)
            if len(samples):
                items += [*self._bursts.end(), samples]
                self._wake_ns = int(samples.last_byte_ns[-1]) + self._timeout_ns
            begin, remaining = split(remaining, slowly)
            slowly *= 2
            for data, at_ns in begin:
                step = self.received(data, at_ns)
                send += step.send
                items += step.items
                if step.hang_up:
                    return Step(send, tuple(items), hang_up=True)
        return Step(send, tuple(items), self._wake_ns)


def split(arrivals: Sequence[Arrival], size: int) -> tuple[list[Arrival], list[Arrival]]:
    """Return the first so many bytes of the arrivals, and those after them, each with its stamp."""
    before, after = list[Arrival](), list[Arrival]()
    for data, at_ns in arrivals:
        if data[:size]:
            before.append((data[:size], at_ns))
        if data[size:]:
            after.append((data[size:], at_ns))
        size = max(0, size - len(data))
    return before, after
