"""Interface of every protocol: bytes and time in; bytes to send, samples and faults out.

A conversation accesses no port, socket or clock. The caller calls `connected` once, then `received` for incoming bytes,
or `tick` when `wake_ns` has passed and no data has arrived. Host side and device side of a protocol are both
conversations; a device side emits no items. A fault is an item in the stream, never an exception: a faulty peer must
not end an acquisition. Times are ns of the monotonic clock of the host.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from enum import StrEnum
from itertools import groupby, starmap
from operator import attrgetter
from typing import Any, Protocol, overload, runtime_checkable

import numpy as np
from numpy.typing import NDArray

NO_TIME = -1
"""Timestamp of a missing request, for a device that streams unprompted."""


class FaultKind(StrEnum):
    GARBLED = "garbled"
    """Bytes that do not form a message of this protocol; ignored."""
    MISSHAPEN = "misshapen"
    """A number in a different format than before: a character is lost, doubled or wrong. The number is left out."""
    UNIT_CHANGED = "unit_changed"
    """A change in the number of decimals, or of the readings by a factor of 25.4: the in/mm key was pressed."""
    LINE = "line"
    """Characters reported by the port as lost or damaged: overrun, framing or parity errors."""
    DEVICE_ERROR = "device_error"
    MISSING = "missing"
    """A valid message that lacks the requested channel or field."""
    SILENT = "silent"
    LATE = "late"
    """Late data, ignored: an answer to an abandoned request, or a repeated or reordered datagram."""
    SKIPPED = "skipped"
    """The clock or counter of the device reveals missing messages."""
    STRANGER = "stranger"
    """Data of a third party, ignored: a datagram of a different sender, or a request of a second master."""
    DISCONNECTED = "disconnected"
    """The link is lost or cannot be opened."""
    DOUBTFUL = "doubtful"
    """Well-formed but implausible readings. They are stored."""
    DROPPED = "dropped"
    """Samples lost on the host because a buffer was full."""
    OUT_OF_STEP = "out_of_step"
    """A replay deviated from the timing of the capture. The count is in seconds."""
    STALLED = "stalled"
    """The host, rigd or a reader stalled: data was read and stamped late."""
    CLOCK = "clock"
    """The wall clock of the host was set, or the host slept. Reported for the host instead of a stream."""


@dataclass(frozen=True, slots=True)
class Sample:
    values: tuple[float, ...]
    """In the order of the columns, in file units (mm, degrees); nan for a value absent from the message."""
    requested_ns: int
    first_byte_ns: int
    last_byte_ns: int
    size: int
    """Bytes of the message, for the transmission time."""
    device_time_s: float = math.nan
    status: int = 0
    """0 for good, otherwise the code of the device for a doubtful reading."""


@dataclass(frozen=True, slots=True)
class Fault:
    kind: FaultKind
    at_ns: int
    detail: str
    count: int = 1
    """Number of affected messages; 0 adds details to an earlier fault."""
    column: int | None = None
    """Index of the affected gauge among the columns if gauges are polled separately; not stored."""


@dataclass(frozen=True, slots=True, eq=False)
class SampleBlock(Sequence[Sample]):
    """Block of samples as arrays: values (n, columns), all others (n,)."""

    values: NDArray[np.float64]
    requested_ns: NDArray[np.int64]
    first_byte_ns: NDArray[np.int64]
    last_byte_ns: NDArray[np.int64]
    size: NDArray[np.int64]
    device_time_s: NDArray[np.float64]
    status: NDArray[np.int64]

    @classmethod
    def of(cls, samples: Sequence[Sample]) -> SampleBlock:
        if isinstance(samples, cls):
            return samples
        if not samples:
            return NO_SAMPLES
        columns: Iterator[Any] = map(np.array, zip(*map(_FIELDS, samples), strict=True), _KINDS)
        return cls(*columns)

    @classmethod
    def joined(cls, blocks: Sequence[SampleBlock]) -> SampleBlock:
        full = [block for block in blocks if len(block)]
        if len(full) < 2:
            return full[0] if full else NO_SAMPLES
        return cls(*(np.concatenate(parts) for parts in zip(*map(_FIELDS, full), strict=True)))

    def chosen(self, which: slice | NDArray[np.bool_]) -> SampleBlock:
        return SampleBlock(*(column[which] for column in _FIELDS(self)))

    def __len__(self) -> int:
        return len(self.last_byte_ns)

    def __iter__(self) -> Iterator[Sample]:
        values, *others = (column.tolist() for column in _FIELDS(self))
        return starmap(Sample, zip(map(tuple, values), *others, strict=True))

    @overload
    def __getitem__(self, place: int) -> Sample: ...
    @overload
    def __getitem__(self, place: slice) -> SampleBlock: ...
    def __getitem__(self, place: int | slice) -> Sample | SampleBlock:
        if isinstance(place, slice):
            return self.chosen(place)
        values, *others = (column[place].tolist() for column in _FIELDS(self))
        return Sample(tuple(values), *others)


_FIELDS: attrgetter[tuple[Any, ...]] = attrgetter(*(field.name for field in fields(Sample)))
"""All fields, in the common order of samples and blocks."""
_KINDS = (np.float64, np.int64, np.int64, np.int64, np.int64, np.float64, np.int64)
_NONE: list[Any] = [np.empty(0, kind) for kind in _KINDS[1:]]
NO_SAMPLES = SampleBlock(np.empty((0, 0)), *_NONE)

Item = Sample | SampleBlock | Fault
Arrival = tuple[bytes, int]


def packed(items: Sequence[Item]) -> list[SampleBlock | Fault]:
    """Combine adjacent samples into blocks."""
    blocks: list[SampleBlock | Fault] = []
    for kind, group in groupby(items, type):
        alike: list[Any] = list(group)
        blocks += [SampleBlock.of(alike)] if kind is Sample else alike
    return blocks


@dataclass(frozen=True, slots=True)
class ConversationStep:
    send: bytes = b""
    items: tuple[Item, ...] = ()
    """Samples and faults to pass on."""
    wake_ns: int | None = None
    hang_up: bool = False
    """Reopen the link, because it is useless now (stream out of step, refusal)."""
    dtr: bool | None = None
    """New state of the modem line DTR; None leaves it unchanged."""


class Conversation(Protocol):
    """A side of a protocol on a link. A new link needs a new conversation."""

    def connected(self, now_ns: int) -> ConversationStep:
        """The link was opened."""
        return ConversationStep()

    def received(self, data: bytes, now_ns: int) -> ConversationStep:
        """Bytes were received, the last at `now_ns`."""
        return ConversationStep()

    def tick(self, now_ns: int) -> ConversationStep:
        """No data has arrived until `wake_ns`."""
        return ConversationStep()


@runtime_checkable
class Gathering(Protocol):
    """Conversation that only listens, at a rate for which batch processing is better."""

    gather_ns: int
    """Longest time for gathering arrivals, counted from the first."""

    def received_all(self, arrivals: Sequence[Arrival]) -> ConversationStep:
        """Handle arrivals in order, with the same result as one by one."""


class Host(Conversation, Protocol):
    def handle_link_loss(self, now_ns: int) -> tuple[Item, ...]:
        """Pending counted faults after the loss of the link."""


class Device(Conversation, Protocol):
    @property
    def sent(self) -> int:
        """Number of readings or packets sent."""


_REPEATING = {
    FaultKind.GARBLED,
    FaultKind.MISSHAPEN,
    FaultKind.UNIT_CHANGED,
    FaultKind.DEVICE_ERROR,
    FaultKind.MISSING,
    FaultKind.STRANGER,
}
_SAME = {FaultKind.GARBLED, FaultKind.MISSHAPEN}
"""Faults whose text quotes the message. They count as equal despite different texts."""
_TELL_NS = 1_000_000_000


class Bursts:
    """Merges repeated faults: the first is reported immediately, the others are counted and reported each second.

    Kinds with a separate count or rate (SILENT, LATE, SKIPPED) pass unchanged.
    """

    def __init__(self) -> None:
        self._open: dict[tuple[FaultKind, str], Fault] = {}
        """Open faults by identity, with the count that is not reported yet."""

    def merge(self, items: Sequence[Item], now_ns: int) -> list[Item]:
        """Items of a message except repeated faults, plus the merged faults that are due."""
        if not self._open and Fault not in map(type, items):  # cheaper per message than a generator with `any`
            return list(items)
        coming = {_sameness(item) for item in items if isinstance(item, Fault)}
        merged = [fault for key in list(self._open) if key not in coming for fault in self._close(key)]
        for item in items:
            if not isinstance(item, Fault) or item.kind not in _REPEATING:
                merged.append(item)
            elif (key := _sameness(item)) not in self._open:
                merged.append(item)
                self._open[key] = replace(item, at_ns=now_ns, count=0)
            else:
                fault = replace(self._open[key], count=self._open[key].count + item.count)
                due = now_ns - fault.at_ns >= _TELL_NS
                self._open[key] = replace(fault, at_ns=now_ns, count=0) if due else fault
                merged += [fault] if due else []
        return merged

    def end(self) -> list[Item]:
        return [fault for key in list(self._open) for fault in self._close(key)]

    def _close(self, key: tuple[FaultKind, str]) -> list[Item]:
        fault = self._open.pop(key)
        return [fault] if fault.count else []


def _sameness(fault: Fault) -> tuple[FaultKind, str]:
    return fault.kind, "" if fault.kind in _SAME else fault.detail
