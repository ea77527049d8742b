"""Reader thread of a link: opens the link, runs the conversation, and reopens the link after a loss.

A lost link causes one DISCONNECTED fault. All failed attempts until the next sample belong to the same outage. Each
reason is reported once, and the first sample reports the duration, both as faults with count 0.
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
from daq.protocol.numerals import keep_formats
from daq.wire.capture import CaptureMark
from daq.wire.conversation_loop import run_conversation
from daq.wire.links import Link, LinkLost
from rigs.errors import CellError

_FIRST_PAUSE_S = 0.2
_LONGEST_PAUSE_S = 5.0
_BUSY_S = 0.01
"""Interval between checks of the processor time: 300 messages of 30 µs, more than a gauge at 12 kHz sends in 20 ms."""
_SHARE = 0.5
"""Largest share of a processor for a reader: a gauge at 12 kHz needs a third, and a flood needs all."""


class StreamReader(clock.StoppableThread):
    def __init__(self, stream: Stream, buffer: StreamBuffer, link: Link, capture: CaptureWriter | None = None) -> None:
        super().__init__(f"read {stream.name}")
        self._stream, self._buffer, self._capture = stream, buffer, capture
        self._link: Link | None = link
        self._pause_s = _FIRST_PAUSE_S
        self._lost_ns: int | None = None
        """Start of the current outage, or None while the link is open."""
        self._used_s = self._looked_s = 0.0
        self._before: Host | None = None
        self._reasons: set[str] = set()

    def run(self) -> None:
        while not self._stop_asked.is_set():
            self._buffer.beat()
            if self._link is not None:
                self._read(self._link)
                continue
            try:
                with self._buffer.opening():
                    self._link = self._stream.open()
            except CellError as error:
                if str(error) not in self._reasons:
                    self._reasons.add(str(error))
                    self._report(str(error), 0)
                self._back_off()
        if self._link is not None:
            self._link.close()

    def _read(self, link: Link) -> None:
        self._buffer.connected = True
        self._capture_mark(CaptureMark.OPENED, self._stream.port)
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
        keep_formats(self._before, conversation)
        self._before = conversation
        try:
            run_conversation(recorded, conversation, deliver, self._stop_asked.is_set, alive)
            reason = "the protocol failed"
        except LinkLost as error:
            reason = str(error)
        finally:
            self._buffer.connected = False
            link.close()
            self._link = None
        self._capture_mark(CaptureMark.LOST, reason)
        self._buffer.deliver(conversation.handle_link_loss(clock.now_ns()))
        if not self._stop_asked.is_set():
            self._lost_ns = self._lost_ns or clock.now_ns()
            self._report(f"{self._stream.port} lost: {reason}; reopening", 1)
            self._back_off()

    def _give_way(self) -> None:
        """Pause if the thread has exceeded its share of the processor, for as long as it used the processor."""
        elapsed_s = clock.now_s() - self._looked_s
        if elapsed_s < _BUSY_S:
            return
        before_s, self._used_s = self._used_s, clock.worked_s()
        used_s = self._used_s - before_s
        if used_s > max(_BUSY_S, _SHARE * elapsed_s):
            clock.sleep(used_s)
        self._looked_s = clock.now_s()

    def _deliver(self, items: Sequence[Item]) -> None:
        if self._lost_ns is not None and not all(isinstance(item, Fault) for item in items):
            lost_ns = self._lost_ns
            self._lost_ns, self._pause_s = None, _FIRST_PAUSE_S
            self._reasons.clear()
            self._report(f"{self._stream.port} reconnected after {(clock.now_ns() - lost_ns) / 1e9:.1f} s", 0)
        self._buffer.deliver(items)

    def _back_off(self) -> None:
        """Wait before the next attempt, with heartbeats, for twice as long each time, up to a limit."""
        until = clock.now_s() + self._pause_s
        while not self._stop_asked.wait(min(0.2, max(0.0, until - clock.now_s()))):
            self._buffer.beat()
            if clock.now_s() >= until:
                break
        self._pause_s = min(_LONGEST_PAUSE_S, 2 * self._pause_s)

    def _capture_mark(self, mark: CaptureMark, text: str) -> None:
        if self._capture:
            self._capture.add(self._stream.name, mark, text.encode("ascii", "replace"))

    def _report(self, detail: str, count: int) -> None:
        self._buffer.deliver([Fault(FaultKind.DISCONNECTED, clock.now_ns(), detail, count)])


_SWITCH_S = 0.0001
"""A fiftieth of the default. It is ten times the usual work of a reader, so the switches are cheap."""


def keep_stamps_prompt() -> None:
    """Configure the interpreter for readers, once, after all imports.

    Only one thread runs Python at a time: a computing thread releases the interpreter after the switch interval, and
    all wait while the garbage collector visits all objects. Those of start-up are never garbage and therefore frozen.
    """
    sys.setswitchinterval(_SWITCH_S)
    gc.collect()
    gc.freeze()
