"""Instruments that answer a short request with a short message: what they have in common, on both sides.

A driver adds its dialect: the request, what ends a message, and `read`, which says what one message means for one
gauge: its reading in mm, or a `Trouble` in words. The gauges that share a link share the message. A gauge in
trouble reads nan beside one that is well; where all are, there is no sample. `TextDevice` is the instrument, of
which a driver adds what it answers.

Where one sends no unit, and for what a line does to the rest, every number is held to the shape of those before it
(`daq.protocol.numerals`).

An instrument that sends its unit is held to that of the rig file (`in_mm`): a reading in another unit is reported as a
fault and never converted, since either the gauge or the file is not what its owner believes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from daq.protocol.conversation import Fault, FaultKind, Item, Sample, Step
from daq.protocol.framing import Framer, Lines, Message
from daq.protocol.numerals import HeldShape, Written, refusal
from daq.protocol.polled import Reply, Then
from rigs.schema.probe import MM_PER_UNIT, Probe, Units

CHECK = "check the cable, that the gauge is on, and the line's settings"
SIGNED = rb"[+-]\d{1,7}\.\d{1,7}"
"""A number whose sign must be there: one that lost its first byte would otherwise pass with the wrong sign."""
_UNITS: dict[bytes, Units] = {b"mm": "mm", b"um": "um", b"in": "inch", b"inch": "inch"}

Show = Callable[[], Sequence[float]]
"""Takes a reading: one number a gauge, in its units; nan where its head is in error."""
ProbeT = TypeVar("ProbeT", bound=Probe)


@dataclass(frozen=True, slots=True)
class Trouble:
    """The reason why a message holds no reading, with what to do about it."""

    detail: str
    kind: FaultKind = FaultKind.DEVICE_ERROR
    then: Then = Then.PAUSE


Reading = float | Written | Trouble
"""A reading in mm, one with the text that it was read from, or the reason why it is missing."""


def garbled(data: bytes) -> Trouble:
    """Return the trouble that the message does not belong to this protocol."""
    return Trouble(f"{shown(data)} is not a reading; check the line's settings", FaultKind.GARBLED, Then.DRAIN)


def shown(data: bytes) -> str:
    """Return a message as a person can read it."""
    return repr(data[:60])[1:]


def mm(number: bytes, gauge: Probe, fields: int = 1) -> Reading:
    """Convert a number in the gauge's units to mm, blanks in it ignored; Trouble where the gauge cannot read it.

    fields: how many numbers the message has, where their order says whose they are.
    """
    value_mm = float(number.replace(b" ", b"")) * MM_PER_UNIT[gauge.units]
    if refused := refusal(value_mm, gauge):
        kind, detail = refused
        return Trouble(detail, kind)
    return Written(value_mm, number, MM_PER_UNIT[gauge.units], fields)


def in_mm(number: bytes, unit: bytes, gauge: Probe) -> Reading:
    """Convert a number whose unit the instrument sends to mm; Trouble if that is not the gauge's unit."""
    sent = _UNITS.get(unit.lower())
    if sent == gauge.units:
        return mm(number, gauge)
    return wrong_unit(sent or shown(unit), gauge.units)


def wrong_unit(sent: str, units: Units) -> Trouble:
    """Return the trouble that an instrument reads in another unit than the rig file says."""
    return Trouble(f"the gauge reads in {sent}, the rig file says {units}; switch the gauge over, or correct `units`")


def items_of(message: Message, requested_ns: int, readings: Sequence[Reading]) -> tuple[Item, ...]:
    """Return a sample of the good readings, and a fault for each trouble."""
    at_ns = message.last_byte_ns
    troubles = dict.fromkeys(reading for reading in readings if isinstance(reading, Trouble))
    faults = tuple(Fault(trouble.kind, at_ns, trouble.detail) for trouble in troubles)
    if all(isinstance(reading, Trouble) for reading in readings):
        return faults
    values_mm = tuple(
        math.nan if isinstance(reading, Trouble) else reading.value_mm if isinstance(reading, Written) else reading
        for reading in readings
    )
    return (Sample(values_mm, requested_ns, message.first_byte_ns, at_ns, message.size), *faults)


def held(
    readings: Sequence[Reading], shapes: Sequence[HeldShape], message: Message
) -> tuple[list[Reading], tuple[Fault, ...]]:
    """Hold each gauge's number to the shape of those before it; return the readings, and the other faults."""
    checked, faults = list[Reading](), list[Fault]()
    for reading, shape in zip(readings, shapes, strict=True):
        if not isinstance(reading, Written):
            checked.append(reading)
            continue
        good, doubt = shape.check(reading)
        if good:
            checked.append(reading.value_mm)
            faults += [Fault(doubt.kind, message.last_byte_ns, doubt.detail, doubt.count)] if doubt else []
        elif doubt:
            checked.append(Trouble(doubt.detail, doubt.kind, Then.ASK))  # its message was whole
    return checked, tuple(faults)


class TextDialect(Generic[ProbeT]):
    """A dialect of `daq.protocol.polled` that repeats the same request."""

    def __init__(
        self,
        gauges: Sequence[ProbeT],
        request: bytes,
        frames: Framer,
        read: Callable[[bytes, ProbeT], Reading],
        check: str = CHECK,
        reset: bytes = b"",
        *,
        may_echo: bool = True,
    ) -> None:
        """may_echo: whether a message that begins with the request is its echo, and not an answer."""
        if may_echo and isinstance(frames, Lines):
            frames.echo = request
        self.frames = frames
        self.check = check
        self.babble = "is the instrument sending by itself?"
        self.reset = reset
        self.shapes = [HeldShape() for _ in gauges]
        self._gauges = gauges
        self._request = request
        self._read = read

    def request(self) -> bytes:
        return self._request

    def read(self, message: Message, requested_ns: int) -> Reply:
        read = [self._read(message.data, gauge) for gauge in self._gauges]
        readings, doubts = held(read, self.shapes, message)
        items = items_of(message, requested_ns, readings)
        if isinstance(items[0], Sample):
            return Reply((*items, *doubts))
        thens = {reading.then for reading in readings if isinstance(reading, Trouble)}
        return Reply(items, next(then for then in (Then.DRAIN, Then.PAUSE, Then.ASK) if then in thens))


class TextDevice:
    """The side of an instrument that answers requests.

    `answer` gives what it says to a command, and empty bytes for nothing; a command that is incomplete is empty.
    """

    def __init__(
        self,
        gauges: Sequence[Probe],
        read: Callable[[int], Sequence[float]],
        frames: Framer,
        answer: Callable[[bytes, Show], bytes],
    ) -> None:
        self.sent = 0
        self._gauges = gauges
        self._read = read
        self._frames = frames
        self._answer = answer

    def connected(self, now_ns: int) -> Step:
        return Step()

    def received(self, data: bytes, now_ns: int) -> Step:
        commands = [
            message.data if isinstance(message, Message) else b"" for message in self._frames.feed(data, now_ns)
        ]
        return Step(b"".join(self._answer(command, lambda: self.show(now_ns)) for command in commands))

    def tick(self, now_ns: int) -> Step:
        return Step()

    def show(self, now_ns: int) -> list[float]:
        """Take a reading, and count it where any head is well."""
        units = [MM_PER_UNIT[gauge.units] for gauge in self._gauges]
        values = [value / unit for value, unit in zip(self._read(now_ns), units, strict=True)]
        self.sent += any(math.isfinite(value) for value in values)
        return values
