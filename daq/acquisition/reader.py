"""The reader thread of a link: it opens the link, runs the conversation, and opens it again whenever it is lost.

A link that is lost makes one DISCONNECTED fault. Until the next sample it is the same outage, however often the port
refuses to open: each reason for that is reported once, and the first sample ends it with its length, both as faults
of count 0. Between two attempts the reader pauses, longer each time up to a bound.

Readers stamp promptly beside the other threads of the daemon, of which one at a time runs Python. Two things hold one
up that has just been woken by its bytes. A thread that computes gives way only when it is asked to, after the
interpreter's switch interval. And no thread runs while Python's collector visits all objects; those that the daemon
starts with, its libraries above all, are some hundred thousand and never garbage.
"""

from __future__ import annotations

import gc
import sys
from collections.abc import Sequence

from daq import clock
from daq.acquisition.capture_writer import CaptureWriter
from daq.acquisition.stream_buffer import StreamBuffer
from daq.acquisition.streams import Stream
from daq.protocol.conversation import Fault, FaultKind, Host, Item
from daq.protocol.numerals import hand_on
from daq.wire.capture import Mark
from daq.wire.conversation_loop import run_conversation
from daq.wire.links import Link, LinkLost
from rigs.errors import CellError

_FIRST_PAUSE_S = 0.2
_LONGEST_PAUSE_S = 5.0
_BUSY_S = 0.01
"""A message takes some 30 µs, so this is 300 of them in one read: more than a gauge at 12 kHz brings in 20 ms."""


class Reader(clock.Thread):
    """Reads one stream into its buffer until it is stopped."""

    def __init__(self, stream: Stream, buffer: StreamBuffer, link: Link, capture: CaptureWriter | None = None) -> None:
        super().__init__(name=f"read {stream.name}", daemon=True)
        self._stream, self._buffer, self._capture = stream, buffer, capture
        self._link: Link | None = link
        self._stop_asked = clock.Event()
        self._pause_s = _FIRST_PAUSE_S
        self._lost_ns: int | None = None
        """When the present outage began; None while the link is up."""
        self._used_s = self._looked_s = 0.0
        """Processor time of this thread when it was last looked at, and when that was."""
        self._before: Host | None = None
        """The conversation on the link before it was lost."""
        self._reasons: set[str] = set()
        """Why the port did not open, as reported in this outage."""

    def stop(self) -> None:
        """Ask the thread to end; join it afterwards."""
        self._stop_asked.set()

    def run(self) -> None:
        """Do the work until `stop`: the body of the thread."""
        while not self._stop_asked.is_set():
            self._buffer.beat()
            if self._link is None:
                self._reopen()
            else:
                self._read(self._link)
        if self._link is not None:
            self._link.close()

    def _read(self, link: Link) -> None:
        self._buffer.connected = True
        self._capture_mark(Mark.OPENED, self._stream.port)
        recorded = self._capture.captured(self._stream.name, link) if self._capture else link

        def deliver(items: Sequence[Item]) -> None:
            link.note_items(items)
            self._deliver(items)

        def alive() -> None:
            self._buffer.beat()
            self._give_way()
            if ignored := link.take_ignored():
                self._buffer.deliver(ignored)

        conversation = self._stream.host()
        hand_on(self._before, conversation)
        self._before = conversation
        try:
            run_conversation(recorded, conversation, deliver, self._stop_asked.is_set, alive)
            reason = "the conversation could not go on"
        except LinkLost as error:
            reason = str(error)
        finally:
            self._buffer.connected = False
            link.close()
            self._link = None
        self._capture_mark(Mark.LOST, reason)
        self._buffer.deliver(conversation.lost(clock.now_ns()))
        if not self._stop_asked.is_set():
            self._lost_ns = self._lost_ns or clock.now_ns()
            self._report(f"{self._stream.port} lost: {reason}; opening it again", 1)
            self._back_off()

    def _give_way(self) -> None:
        """Pause for as long as the last rounds took the processor, if that was long: one thread at a time runs Python.

        What a stream that floods sends meanwhile waits in the system, and its sender with it where the link is TCP.
        """
        if clock.now_s() - self._looked_s < _BUSY_S:
            return
        before_s, self._used_s = self._used_s, clock.worked_s()
        if self._used_s - before_s > _BUSY_S:
            clock.sleep(self._used_s - before_s)
        self._looked_s = clock.now_s()

    def _deliver(self, items: Sequence[Item]) -> None:
        if self._lost_ns is not None and not all(isinstance(item, Fault) for item in items):
            lost_ns = self._lost_ns
            self._lost_ns, self._pause_s = None, _FIRST_PAUSE_S
            self._reasons.clear()
            self._report(f"{self._stream.port} is back after {(clock.now_ns() - lost_ns) / 1e9:.1f} s", 0)
        self._buffer.deliver(items)

    def _reopen(self) -> None:
        try:
            with self._buffer.opening():
                self._link = self._stream.open()
        except CellError as error:
            if str(error) not in self._reasons:
                self._reasons.add(str(error))
                self._report(str(error), 0)
            self._back_off()

    def _back_off(self) -> None:
        """Back off, doubling up to a bound, without missing a heartbeat."""
        until = clock.now_s() + self._pause_s
        while not self._stop_asked.wait(min(0.2, max(0.0, until - clock.now_s()))):
            self._buffer.beat()
            if clock.now_s() >= until:
                break
        self._pause_s = min(_LONGEST_PAUSE_S, 2 * self._pause_s)

    def _capture_mark(self, mark: Mark, text: str) -> None:
        if self._capture:
            self._capture.add(self._stream.name, mark, text.encode("ascii", "replace"))

    def _report(self, detail: str, count: int) -> None:
        self._buffer.deliver([Fault(FaultKind.DISCONNECTED, clock.now_ns(), detail, count)])


_SWITCH_S = 0.0001
"""A fiftieth of Python's default, and some ten times what a reader needs before it waits again: so the switches
themselves cost little."""


def keep_stamps_prompt() -> None:
    """Set this process up for readers; call it once everything is loaded."""
    sys.setswitchinterval(_SWITCH_S)
    gc.collect()
    gc.freeze()
