"""What every protocol is: bytes and time in, bytes to send, samples and faults out.

A conversation touches no operating system: no port, no socket, no clock. Its caller owns the
link and the clock, and calls `connected` once, then `received` for bytes as they come or `tick` when
`wake_ns` has passed without any. The host's side and the device's side of a protocol are both
conversations; a device's side sends and emits no items.

A fault is an item in the stream and never an exception: a bad peer must not end an acquisition.
Times are integer nanoseconds on the host's monotonic clock.

A fault that keeps coming is reported once a second instead of a thousand times. The first is reported at once. Those
that follow without a message free of it in between are counted, and reported as one when they end or a second has
passed. What has its own count or its own pace (SILENT, LATE, SKIPPED) passes unchanged.
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
"""A stamp that does not exist: the request of a device that streams by itself."""


class FaultKind(StrEnum):
    """What can go wrong on a link."""

    GARBLED = "garbled"
    """Bytes that are not a message of this protocol; ignored."""
    MISSHAPEN = "misshapen"
    """A number that is not written as those before it: a character is lost, doubled or false; left out."""
    UNIT_CHANGED = "unit_changed"
    """The gauge writes another number of decimals, or readings a 25.4th or 25.4-fold: in/mm was pressed."""
    LINE = "line"
    """Characters that the port itself calls lost or damaged: overruns, wrong framing, wrong parity."""
    DEVICE_ERROR = "device_error"
    """The device answered with its own error code."""
    MISSING = "missing"
    """A good message that lacks the channel or field asked for."""
    SILENT = "silent"
    """No answer within the time allowed."""
    LATE = "late"
    """Something came after its turn and is ignored: an answer to a request that was already given up, or a datagram
    that came twice or after a later one."""
    SKIPPED = "skipped"
    """The device's own clock or counter shows that messages are missing."""
    STRANGER = "stranger"
    """Something of a third party, which is ignored: a datagram of another sender, a request of another master."""
    DISCONNECTED = "disconnected"
    """The link is gone or refuses to open."""
    DOUBTFUL = "doubtful"
    """Readings that are well-formed but implausible; they are kept."""
    DROPPED = "dropped"
    """Samples lost on the host because a buffer was full."""
    OUT_OF_STEP = "out_of_step"
    """A replay was not in step with its capture; counted in seconds."""
    STALLED = "stalled"
    """The host, rigd or one reader stood still: what came meanwhile was read late, and its stamps are late as well."""
    CLOCK = "clock"
    """The host's wall clock was set, or the host slept; reported for the host itself and not for a stream."""


@dataclass(frozen=True, slots=True)
class Sample:
    """One message that carries a reading.

    values: in the order of the conversation's columns, in file units (mm, degrees); nan where the
    message did not carry it. size: bytes of the message, from which its wire time follows.
    device_time_s: the device's own clock, nan without one. status: 0 good, else the device's own code
    for a reading that it calls doubtful.
    """

    values: tuple[float, ...]
    requested_ns: int
    first_byte_ns: int
    last_byte_ns: int
    size: int
    device_time_s: float = math.nan
    status: int = 0


@dataclass(frozen=True, slots=True)
class Fault:
    """Something that went wrong, in words that help a person; `count` messages were affected.

    A count of 0 adds details to what was counted before. column: place among the conversation's columns of the gauge
    that it concerns, where each gauge is asked by itself; it is not stored.
    """

    kind: FaultKind
    at_ns: int
    detail: str
    count: int = 1
    column: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Samples(Sequence[Sample]):
    """Many samples in order, as arrays, which cost next to nothing by the thousand.

    values: (n, columns); every other field: (n,).
    """

    values: NDArray[np.float64]
    requested_ns: NDArray[np.int64]
    first_byte_ns: NDArray[np.int64]
    last_byte_ns: NDArray[np.int64]
    size: NDArray[np.int64]
    device_time_s: NDArray[np.float64]
    status: NDArray[np.int64]

    @classmethod
    def of(cls, samples: Sequence[Sample]) -> Samples:
        """Return these samples as a block."""
        if isinstance(samples, cls):
            return samples
        if not samples:
            return NO_SAMPLES
        columns: Iterator[Any] = map(np.array, zip(*map(_FIELDS, samples), strict=True), _KINDS)
        return cls(*columns)

    @classmethod
    def joined(cls, blocks: Sequence[Samples]) -> Samples:
        """Return all samples of these blocks, in order."""
        full = [block for block in blocks if len(block)]
        if len(full) < 2:
            return full[0] if full else NO_SAMPLES
        return cls(*(np.concatenate(parts) for parts in zip(*map(_FIELDS, full), strict=True)))

    def chosen(self, which: slice | NDArray[np.bool_]) -> Samples:
        """Return some of the samples, stamps in ns as they are: those of a slice, or where the mask (n,) is true."""
        return Samples(*(column[which] for column in _FIELDS(self)))

    def __len__(self) -> int:
        return len(self.last_byte_ns)

    def __iter__(self) -> Iterator[Sample]:
        values, *others = (column.tolist() for column in _FIELDS(self))
        return starmap(Sample, zip(map(tuple, values), *others, strict=True))

    @overload
    def __getitem__(self, place: int) -> Sample: ...
    @overload
    def __getitem__(self, place: slice) -> Samples: ...
    def __getitem__(self, place: int | slice) -> Sample | Samples:
        if isinstance(place, slice):
            return self.chosen(place)
        values, *others = (column[place].tolist() for column in _FIELDS(self))
        return Sample(tuple(values), *others)


_FIELDS: attrgetter[tuple[Any, ...]] = attrgetter(*(field.name for field in fields(Sample)))
"""The fields of a sample, and those of a block, which have the same names, in order."""
_KINDS = (np.float64, np.int64, np.int64, np.int64, np.int64, np.float64, np.int64)
_NONE: list[Any] = [np.empty(0, kind) for kind in _KINDS[1:]]
NO_SAMPLES = Samples(np.empty((0, 0)), *_NONE)

Item = Sample | Samples | Fault
Arrival = tuple[bytes, int]
"""Bytes that came at once, and when."""


def packed(items: Sequence[Item]) -> list[Samples | Fault]:
    """Return the items in their order, with single samples that follow one another as a block."""
    blocks: list[Samples | Fault] = []
    for kind, group in groupby(items, type):
        alike: list[Any] = list(group)
        blocks += [Samples.of(alike)] if kind is Sample else alike
    return blocks


@dataclass(frozen=True, slots=True)
class Step:
    """What a conversation wants done: send these bytes, pass on these items, wake it by then.

    hang_up: no more can come of this link (a stream out of step, a refusal); close it and open a new one. dtr: how this
    modem line is to be from now on; None leaves it.
    """

    send: bytes = b""
    items: tuple[Item, ...] = ()
    wake_ns: int | None = None
    hang_up: bool = False
    dtr: bool | None = None


class Conversation(Protocol):
    """One side of one protocol on one link, from connect to disconnect; a new link takes a new one."""

    def connected(self, now_ns: int) -> Step:
        """The link has just opened."""

    def received(self, data: bytes, now_ns: int) -> Step:
        """These bytes came, the last of them at `now_ns`."""

    def tick(self, now_ns: int) -> Step:
        """`wake_ns` has passed and no bytes came."""


@runtime_checkable
class Gathering(Protocol):
    """A conversation that only listens, to so many messages that several are better read at once.

    What it makes of arrivals is what it would make of them one by one.
    """

    gather_ns: int
    """For how long arrivals may be gathered from the first of them on; each has its own stamp."""

    def received_all(self, arrivals: Sequence[Arrival]) -> Step:
        """These bytes came, in order."""


class Host(Conversation, Protocol):
    """Our side of a conversation: what it emits is all that is known of the link."""

    def lost(self, now_ns: int) -> tuple[Item, ...]:
        """Return what is still to be reported when the link is gone: faults that were counted and held back."""


class Device(Conversation, Protocol):
    """The device's side of a conversation: it sends bytes and emits no items."""

    @property
    def sent(self) -> int:
        """The number of readings or packets sent so far."""


_REPEATING = {
    FaultKind.GARBLED,
    FaultKind.MISSHAPEN,
    FaultKind.UNIT_CHANGED,
    FaultKind.DEVICE_ERROR,
    FaultKind.MISSING,
    FaultKind.STRANGER,
}
_SAME = {FaultKind.GARBLED, FaultKind.MISSHAPEN}
"""Kinds whose text quotes the message: they are the same whatever it was."""
_TELL_NS = 1_000_000_000


class Bursts:
    """Merges the faults of successive messages."""

    def __init__(self) -> None:
        self._open: dict[tuple[FaultKind, str], Fault] = {}
        """Open faults by what makes two of them the same; the count is of those not reported yet."""

    def merge(self, items: Sequence[Item], now_ns: int) -> list[Item]:
        """Return the items of one message, with repeated faults held back and those that are due added."""
        if not self._open and not has_fault(items):
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
        """Return the faults that are still held back."""
        return [fault for key in list(self._open) for fault in self._close(key)]

    def _close(self, key: tuple[FaultKind, str]) -> list[Item]:
        fault = self._open.pop(key)
        return [fault] if fault.count else []


def has_fault(items: Sequence[Item]) -> bool:
    """Return whether a fault is among the items; asked of each message, so without the cost of a generator."""
    return Fault in map(type, items)


def _sameness(fault: Fault) -> tuple[FaultKind, str]:
    return fault.kind, "" if fault.kind in _SAME else fault.detail
