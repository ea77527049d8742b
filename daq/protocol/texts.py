"""Instruments with short text requests and answers: common parts of both sides.

A driver adds the request, the end of a message, and `read`, which converts a message into a reading of a gauge. A gauge
in trouble reads nan next to a good gauge on the same link; if all are in trouble, there is no sample.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from daq.protocol.conversation import (
    NO_TIME,
    Conversation,
    ConversationStep,
    Fault,
    FaultKind,
    Host,
    Item,
    Sample,
)
from daq.protocol.framing import DelimitedLines, Framer, Message
from daq.protocol.numerals import NumberFormat, refusal
from daq.protocol.polled import Polled, Reply, Then
from daq.protocol.printed_number import PrintedNumber
from rigs.schema.probe import MM_PER_UNIT, Probe, Units

CHECK = "check the cable, the power supply of the gauge, and the line settings"
SIGNED = rb"[+-]\d{1,7}\.\d{1,7}"
"""A mandatory sign: otherwise the loss of the first byte would change the sign."""
_UNITS: dict[bytes, Units] = {b"mm": "mm", b"um": "um", b"in": "inch", b"inch": "inch"}

Show = Callable[[], Sequence[float]]
"""Takes a reading: a number per gauge in the units of the gauge; nan for a head in error."""
ProbeT = TypeVar("ProbeT", bound=Probe)


@dataclass(frozen=True, slots=True)
class Trouble:
    detail: str
    kind: FaultKind = FaultKind.DEVICE_ERROR
    then: Then = Then.PAUSE
    count: int = 1


_WITHHELD = Trouble("", then=Then.ASK)
"""A number that the next reply decides: for the moment neither a reading nor a fault."""
Reading = float | PrintedNumber | Trouble
"""Reading in mm, a reading with its text, or the reason for its absence."""


def garbled(data: bytes) -> Trouble:
    return Trouble(
        f"{printable_message(data)} is not a reading; check the line settings", FaultKind.GARBLED, Then.DRAIN
    )


def printable_message(data: bytes) -> str:
    return repr(data[:60])[1:]


def mm(number: bytes, gauge: Probe, fields: int = 1, *, omits_plus: bool = False) -> Reading:
    """Number in the units of the gauge as a reading in mm, ignoring blanks. The rest is as in `PrintedNumber`."""
    value_mm = float(number.replace(b" ", b"")) * MM_PER_UNIT[gauge.units]
    if refused := refusal(value_mm, gauge):
        kind, detail = refused
        return Trouble(detail, kind)
    return PrintedNumber(value_mm, number, MM_PER_UNIT[gauge.units], fields, omits_plus)


def in_mm(number: bytes, unit: bytes, gauge: Probe, *, omits_plus: bool = False) -> Reading:
    """Number with a transmitted unit as a reading in mm.

    Another unit than that of the rig file is never converted, because either the gauge or the file is wrong.
    """
    sent = _UNITS.get(unit.lower())
    if sent == gauge.units:
        return mm(number, gauge, omits_plus=omits_plus)
    return wrong_unit(sent or printable_message(unit), gauge.units)


def wrong_unit(sent: str, units: Units) -> Trouble:
    return Trouble(f"the gauge reads in {sent}, but the rig file has {units}; switch the gauge, or correct `units`")


def items_of(message: Message, requested_ns: int, readings: Sequence[Reading]) -> tuple[Item, ...]:
    faults, values_mm = dict[Trouble, Fault](), list[float]()
    for reading in readings:
        if isinstance(reading, Trouble):
            if reading is not _WITHHELD:
                faults[reading] = message.fault(reading.kind, reading.detail, reading.count)
            values_mm.append(math.nan)
        else:
            values_mm.append(reading.value_mm if isinstance(reading, PrintedNumber) else reading)
    if all(isinstance(reading, Trouble) for reading in readings):
        return tuple(faults.values())
    return (message.sample(values_mm, requested_ns=requested_ns), *faults.values())


def check_formats(
    readings: Sequence[Reading], formats: Sequence[NumberFormat], message: Message, requested_ns: int = NO_TIME
) -> tuple[list[Reading], list[Sample], list[Fault]]:
    """Check the number of each gauge against the format.

    Returns the readings, earlier readings that are now confirmed, and additional faults.
    """
    checked, earlier, doubts = list(readings), list[Sample](), list[Fault]()
    for place, (reading, known) in enumerate(zip(readings, formats, strict=True)):
        if not isinstance(reading, PrintedNumber):
            continue
        is_good, items = known.check(reading, message, requested_ns)
        if is_good:
            earlier += [item for item in items if isinstance(item, Sample)]
            doubts += [item for item in items if isinstance(item, Fault)]
            continue
        checked[place] = _WITHHELD
        for item in items:
            if isinstance(item, Fault):
                checked[place] = Trouble(item.detail, item.kind, Then.ASK, item.count)  # the message was complete
    return checked, earlier, doubts


class TextDialect(Generic[ProbeT]):
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
        """may_echo: a message that starts with the request is an echo, not an answer."""
        if may_echo and isinstance(frames, DelimitedLines):
            frames.echo = request
        self.frames = frames
        self.check = check
        self.babble = "check whether the instrument sends unprompted"
        self.reset = reset
        self.formats = [NumberFormat() for _ in gauges]
        self._gauges = gauges
        self._request = request
        self._read = read

    def request(self) -> bytes:
        return self._request

    def read(self, message: Message, requested_ns: int) -> Reply:
        read = [self._read(message.data, gauge) for gauge in self._gauges]
        readings, earlier, doubts = check_formats(read, self.formats, message, requested_ns)
        items = items_of(message, requested_ns, readings)
        if not items or isinstance(items[0], Sample):
            return Reply((*earlier, *items, *doubts))
        thens = {reading.then for reading in readings if isinstance(reading, Trouble)}
        return Reply(items, next(then for then in (Then.DRAIN, Then.PAUSE, Then.ASK) if then in thens))


def polled_text(
    gauges: Sequence[ProbeT],
    request: bytes,
    end: bytes,
    read: Callable[[bytes, ProbeT], Reading],
    check: str = CHECK,
    reset: bytes = b"",
    *,
    may_echo: bool = True,
) -> Host:
    dialect = TextDialect(gauges, request, DelimitedLines(end), read, check, reset, may_echo=may_echo)
    return Polled(dialect, gauges[0].timeout_s)


class TextDevice(Conversation):
    """Device side of an instrument that answers requests.

    `answer` returns the answer to a command, or empty bytes for none. An incomplete command is empty.
    """

    def __init__(
        self,
        gauges: Sequence[Probe],
        read: Callable[[int], Sequence[float]],
        end: bytes | Framer,
        answer: Callable[[bytes, Show], bytes],
    ) -> None:
        self.sent = 0
        self._gauges = gauges
        self._read = read
        self._frames = DelimitedLines(end) if isinstance(end, bytes) else end
        self._answer = answer

    def received(self, data: bytes, now_ns: int) -> ConversationStep:
        commands = [
            message.data if isinstance(message, Message) else b"" for message in self._frames.feed(data, now_ns)
        ]
        return ConversationStep(b"".join(self._answer(command, lambda: self.show(now_ns)) for command in commands))

    def show(self, now_ns: int) -> list[float]:
        units = [MM_PER_UNIT[gauge.units] for gauge in self._gauges]
        values = [value / unit for value, unit in zip(self._read(now_ns), units, strict=True)]
        self.sent += any(math.isfinite(value) for value in values)
        return values
