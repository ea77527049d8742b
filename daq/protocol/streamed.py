"""Receiving from a device that sends unprompted after it was started.

A silence of `timeout_s` is reported (fault SILENT) once per `timeout_s`, and the dialect selects the reaction. Bytes
that form no message do not end a silence.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

from daq.protocol.conversation import Arrival, Bursts, ConversationStep, Fault, FaultKind, Item, SampleBlock
from daq.protocol.framing import Framer, Message
from daq.protocol.numerals import NumberFormat


@dataclass(frozen=True, slots=True)
class Reaction:
    """Items of a message and the bytes to send. hang_up: close the link because it is useless now."""

    items: tuple[Item, ...] = ()
    send: bytes = b""
    hang_up: bool = False


class StreamedDialect(ABC):
    """Device-specific part. By default the host only listens."""

    frames: Framer
    check: str
    formats: Sequence[NumberFormat] = ()
    """Formats of printed numbers, one per gauge; none for binary values."""

    def start(self) -> bytes:
        return b""

    @abstractmethod
    def read(self, message: Message) -> Reaction:
        """Interpret a message."""

    def garbled(self, fault: Fault) -> Reaction:
        return Reaction((fault,))

    def silent(self) -> Reaction:
        return Reaction()


class Streamed:
    def __init__(self, dialect: StreamedDialect, timeout_s: float) -> None:
        self._dialect, self.formats = dialect, dialect.formats
        self._timeout_s = timeout_s
        self._timeout_ns = round(timeout_s * 1e9)
        self._bursts = Bursts()
        self._wake_ns = 0
        self._over = False

    def connected(self, now_ns: int) -> ConversationStep:
        self._wake_ns = now_ns + self._timeout_ns
        return ConversationStep(self._dialect.start(), wake_ns=self._wake_ns)

    def received(self, data: bytes, now_ns: int) -> ConversationStep:
        send, items = b"", list[Item]()
        if not self._over:
            for message in self._dialect.frames.feed(data, now_ns):
                if isinstance(message, Fault):
                    reaction = self._dialect.garbled(message)
                else:
                    reaction = self._dialect.read(message)
                    self._wake_ns = now_ns + self._timeout_ns
                items += self._bursts.merge(reaction.items, now_ns)
                send += reaction.send
                if reaction.hang_up:
                    return self._finish(send, items)
        return self._watch(send, items, now_ns)

    def tick(self, now_ns: int) -> ConversationStep:
        return self._watch(b"", [], now_ns)

    def handle_link_loss(self, now_ns: int) -> tuple[Item, ...]:
        return tuple(self._bursts.end())

    def _watch(self, send: bytes, items: list[Item], now_ns: int) -> ConversationStep:
        if self._over:
            return ConversationStep(hang_up=True)
        if now_ns >= self._wake_ns:
            detail = f"no data for {self._timeout_s:g} s; {self._dialect.check}"
            items += [*self._bursts.end(), Fault(FaultKind.SILENT, now_ns, detail)]
            self._wake_ns = now_ns + self._timeout_ns
            reaction = self._dialect.silent()
            send += reaction.send
            if reaction.hang_up:
                return self._finish(send, items)
        return ConversationStep(send, tuple(items), self._wake_ns)

    def _finish(self, send: bytes, items: list[Item]) -> ConversationStep:
        self._over = True
        return ConversationStep(send, (*items, *self._bursts.end()), hang_up=True)


class GatheredStream(Streamed):
    """Host side of a device with hundreds of messages per second, which are decoded together.

    A thread that decodes each message on arrival holds the interpreter most often just when another stream's bytes
    arrive: the readers of gauges then stamp late.
    """

    gather_ns = 10_000_000
    """Five packets of a controller: decoded in a third of the time, and before the next one arrives."""

    def received_all(self, arrivals: Sequence[Arrival]) -> ConversationStep:
        send, items = b"", list[Item]()
        for data, at_ns in arrivals:
            step = self.received(data, at_ns)
            send += step.send
            items += step.items
            if step.hang_up:
                return ConversationStep(send, tuple(items), hang_up=True)
        return ConversationStep(send, tuple(items), self._wake_ns)


_FIRST_SLOWLY_BYTES = 48
"""Bytes decoded individually after a failed array decoding, doubled each time to limit the attempts."""


class QuickDialect(StreamedDialect):
    """Device-specific part of a stream with thousands of messages per second."""

    @abstractmethod
    def read_run(self, arrivals: Sequence[Arrival]) -> tuple[SampleBlock, Sequence[Arrival]]:
        """Plain readings at the start of the arrivals, and the remaining arrivals."""


class QuicklyStreamed(GatheredStream):
    """Host side of a device with thousands of messages per second. Plain readings are decoded as arrays."""

    gather_ns = 100_000_000
    """Decoding takes 0.3 ms and affects fewer than one stamp in a hundred; shorter than a round of the recorder."""

    def __init__(self, dialect: QuickDialect, timeout_s: float) -> None:
        super().__init__(dialect, timeout_s)
        self._quick = dialect

    def received_all(self, arrivals: Sequence[Arrival]) -> ConversationStep:
        if self._over:
            return ConversationStep(hang_up=True)
        send, items, remaining, slowly = b"", list[Item](), arrivals, _FIRST_SLOWLY_BYTES
        while remaining:
            samples, remaining = self._quick.read_run(remaining)
            if len(samples):
                items += [*self._bursts.end(), samples]
                self._wake_ns = int(samples.last_byte_ns[-1]) + self._timeout_ns
            begin, remaining = split(remaining, slowly)
            slowly *= 2
            step = super().received_all(begin)
            send += step.send
            items += step.items
            if step.hang_up:
                return ConversationStep(send, tuple(items), hang_up=True)
        return ConversationStep(send, tuple(items), self._wake_ns)


def split(arrivals: Sequence[Arrival], size: int) -> tuple[list[Arrival], list[Arrival]]:
    if sum(len(data) for data, _ in arrivals) <= size:  # the usual case, in a fraction of the time
        return list(arrivals), []
    before, after = list[Arrival](), list[Arrival]()
    for data, at_ns in arrivals:
        if data[:size]:
            before.append((data[:size], at_ns))
        if data[size:]:
            after.append((data[size:], at_ns))
        size = max(0, size - len(data))
    return before, after
