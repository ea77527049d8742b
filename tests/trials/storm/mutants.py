"""Bugs that are planted into recorder and reader from outside, one at a time, to see that a storm finds them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any
from unittest.mock import patch

from daq import clock
from daq.acquisition.reader import StreamReader
from daq.acquisition.stream_buffer import StreamBuffer
from daq.protocol.conversation import Fault, FaultKind, Item
from daq.recording.io_worker import IoWorker
from daq.wire import conversation_loop as session

_PARSING_S = 0.004


@contextmanager
def synced_before_it_is() -> Iterator[None]:
    """What is handed to the disk's thread counts as synced at once."""
    submit = IoWorker._submit_next  # private: the mutant stands in its place

    def submitted(self: IoWorker, *arguments: Any, **options: Any) -> None:
        submit(self, *arguments, **options)
        if (
            self._under_way is not None and self._under_way[0].synced is not None
        ):  # private: the mutant stands in its place
            self.synced = self._under_way[0].synced

    with patch.object(IoWorker, "_submit_next", submitted):
        yield


@contextmanager
def first_batch_after_an_outage_lost() -> Iterator[None]:
    """What ends an outage is not handed on."""
    deliver = StreamReader._deliver  # private: the mutant stands in its place

    def delivered(self: StreamReader, items: Sequence[Item]) -> None:
        was_out = self._lost_ns is not None
        deliver(self, [item for item in items if isinstance(item, Fault)] if was_out else items)
        if was_out and not all(isinstance(item, Fault) for item in items):
            self._end_outage(self._lost_ns or 0)

    with patch.object(StreamReader, "_deliver", delivered):
        yield


@contextmanager
def overflow_not_counted() -> Iterator[None]:
    """Samples that find no room are not counted where the recorder looks."""
    drain = StreamBuffer.drain

    def drained(self: StreamBuffer) -> Any:
        self._without_room.pop(FaultKind.DROPPED, None)  # private: the mutant stands in its place
        return drain(self)

    with patch.object(StreamBuffer, "drain", drained):
        yield


@contextmanager
def stamped_after_reading() -> Iterator[None]:
    """A message is stamped when it has been read, and not when its last byte came. To read one takes no time in a
    simulation, so here it takes as long as on a slow computer."""
    run = session.run_conversation

    def running(link: Any, conversation: Any, *arguments: Any) -> None:
        class Slow:
            def __getattr__(self, name: str) -> Any:
                return getattr(conversation, name)

            def received(self, data: bytes, now_ns: int) -> Any:
                clock.sleep(_PARSING_S)
                return conversation.received(data, clock.now_ns())

            def connected(self, now_ns: int) -> Any:
                return conversation.connected(now_ns)

            def tick(self, now_ns: int) -> Any:
                return conversation.tick(now_ns)

        run(link, Slow(), *arguments)

    with patch("daq.acquisition.reader.run_conversation", running):
        yield


@contextmanager
def no_third_connection() -> Iterator[None]:
    """A reader whose link was lost twice opens it no more."""
    reopen = StreamReader._reopen  # private: the mutant stands in its place

    def reopened(self: StreamReader) -> None:
        opened = self.__dict__.setdefault("opened", [])
        if len(opened) >= 1:
            self._back_off()
            return
        reopen(self)
        if self._link is not None:
            opened.append(clock.now_ns())

    with patch.object(StreamReader, "_reopen", reopened):
        yield


MUTANTS: Mapping[str, Callable[[], Any]] = {
    made.__name__.replace("_", " "): made
    for made in (
        synced_before_it_is,
        first_batch_after_an_outage_lost,
        overflow_not_counted,
        stamped_after_reading,
        no_third_connection,
    )
}
