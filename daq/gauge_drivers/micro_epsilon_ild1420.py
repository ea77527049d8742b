"""Micro-Epsilon optoNCDT 1420 on RS-422: an unprompted stream of three bytes per value, with no timestamp.

The two top bits identify the bytes: 00 low, 01 middle, 10 high, each with six bits of the value. 11 is the high byte of
a further value in the same block (manual of the maker p. 84). A distance x counts from the start of the measuring
range, d = (102/65520 x - 1)/100 range, and is in range for x of 643 … 64877 (p. 65). Codes from 262075 are assumed to
be errors, not confirmed. `OUTPUT RS422` starts the stream (p. 108). The ASCII response to it appears between the
values.

The stream is synchronised after a high byte; ASCII contains none and can neither be mistaken for a value nor complete
one. If a block contains more than the distance, the meaning of the values is unknown: a value is accepted only if the
previous value was the only value of a block. Mastering (zero setting) shifts the formula and must be off.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.gauges import Read
from daq.protocol.conversation import (
    NO_SAMPLES,
    NO_TIME,
    Arrival,
    ConversationStep,
    Device,
    Fault,
    FaultKind,
    Host,
    SampleBlock,
)
from daq.protocol.framing import DelimitedLines, Message
from daq.protocol.positions import SteadyDevice, SteadyRate
from daq.protocol.streamed import QuickDialect, QuicklyStreamed, Reaction, split
from daq.protocol.texts import Reading, Trouble, items_of
from rigs.schema.gauges import MicroEpsilonILD1420

_START = b"OUTPUT RS422\n"
_LOW, _MIDDLE, _HIGH, _FURTHER = range(4)
_FIRST, _LAST, _FIRST_ERROR = 643, 64877, 262075
_NO_PEAK = 262076
_RATE_HZ = 1000.0
_MORE = Trouble("the sensor sends further values; select only the distance for RS422")


def host(gauges: Sequence[MicroEpsilonILD1420]) -> Host:
    (gauge,) = gauges
    return QuicklyStreamed(_ILD1420Dialect(gauge), gauge.timeout_s)


def device(gauges: Sequence[MicroEpsilonILD1420], read: Read) -> Device:
    (gauge,) = gauges
    return _Sensor(gauge, read)


class _Values:
    """Splits the stream into values and reports a misplaced byte once."""

    def __init__(self) -> None:
        self._bytes = bytearray()
        self._first_ns = 0
        self._lost = True

    @property
    def pending(self) -> bool:
        return bool(self._bytes)

    def clear(self) -> None:
        self._bytes.clear()
        self._lost = True

    def take_begun(self) -> list[Arrival] | None:
        """Remove the bytes of an unfinished value; None while the stream is not synchronised."""
        begun = [(bytes(self._bytes), self._first_ns)] if self._bytes else []
        if self._lost:
            return None
        self._bytes.clear()
        return begun

    def feed(self, data: bytes, now_ns: int) -> Sequence[Message | Fault]:
        messages: list[Message | Fault] = []
        for byte in data:
            tag = byte >> 6
            if self._lost:
                self._lost = tag != _HIGH
            elif tag == len(self._bytes) or (tag == _FURTHER and len(self._bytes) == _HIGH):
                if not self._bytes:
                    self._first_ns = now_ns
                self._bytes.append(byte)
                if len(self._bytes) == 3:
                    messages.append(Message(bytes(self._bytes), 3, self._first_ns, now_ns))
                    self._bytes.clear()
            else:
                self._bytes.clear()
                self._lost = tag != _HIGH
                detail = "a byte out of place, the value left out; check the line's settings and the cable"
                messages.append(Fault(FaultKind.GARBLED, now_ns, detail))
        return messages


class _ILD1420Dialect(QuickDialect):
    """Sends `OUTPUT RS422`, and repeats it after a silence."""

    check = "check the cable, the power supply and the line settings, and that the sensor is not in web interface mode"

    def __init__(self, gauge: MicroEpsilonILD1420) -> None:
        self.frames: _Values = _Values()
        self._gauge = gauge
        self._alone = True
        """True if the last message is the only value of a block, as far as known."""

    def start(self) -> bytes:
        return _START

    def garbled(self, fault: Fault) -> Reaction:
        self._alone = True
        return super().garbled(fault)

    def read(self, message: Message) -> Reaction:
        before, self._alone = self._alone, message.data[2] >> 6 == _HIGH
        low, middle, high = (byte & 0x3F for byte in message.data)
        x = low | middle << 6 | high << 12
        reading: Reading
        if not (before and self._alone):
            reading = _MORE
        elif x >= _FIRST_ERROR:
            reading = Trouble(f"error {x} of the sensor: no valid reading; check the target, the range and the laser")
        elif not _FIRST <= x <= _LAST:
            place = f"{'before' if x < _FIRST else 'behind'} the measuring range"
            reading = Trouble(f"the target is {place}, or mastering is on; move the target, or switch mastering off")
        else:
            reading = float(_mm(x, self._gauge))
        return Reaction(items_of(message, NO_TIME, [reading]))

    def read_run(self, arrivals: Sequence[Arrival]) -> tuple[SampleBlock, Sequence[Arrival]]:
        begun = self.frames.take_begun() if self._alone else None
        if begun is None:
            return NO_SAMPLES, arrivals
        arrivals = [*begun, *arrivals]
        data = np.frombuffer(b"".join(piece for piece, _ in arrivals), np.uint8)
        values = data[: len(data) // 3 * 3].reshape(-1, 3)
        codes = (values & 0x3F) @ np.array([1, 1 << 6, 1 << 12])
        plain = (values >> 6 == (_LOW, _MIDDLE, _HIGH)).all(axis=1) & (codes >= _FIRST) & (codes <= _LAST)
        count = int(np.append(plain, False).argmin())
        pieces_ns = np.array([at_ns for _, at_ns in arrivals])
        at_ns = np.repeat(pieces_ns, [len(piece) for piece, _ in arrivals])[: 3 * count].reshape(-1, 3)
        samples = SampleBlock(
            _mm(codes[:count], self._gauge)[:, np.newaxis],
            np.full(count, NO_TIME),
            at_ns[:, 0],
            at_ns[:, 2],
            np.full(count, 3),
            np.full(count, math.nan),
            np.zeros(count, np.int64),
        )
        return samples, split(arrivals, 3 * count)[1]

    def silent(self) -> Reaction:
        return Reaction(send=_START)


def _mm(x: float | NDArray[np.int64], gauge: MicroEpsilonILD1420) -> Any:
    return (102 / 65520 * x - 1) / 100 * gauge.range_mm - gauge.zero_mm


class _Sensor(SteadyDevice):
    IS_STREAM = True

    def __init__(self, gauge: MicroEpsilonILD1420, read: Read) -> None:
        super().__init__(read)
        self._gauge = gauge
        self._commands = DelimitedLines(b"\n")

    def received(self, data: bytes, now_ns: int) -> ConversationStep:
        answer = b""
        for command in self._commands.feed(data, now_ns):
            starts = isinstance(command, Message) and command.data.strip() == _START.strip()
            answer += (_START.strip() if starts else b"E01 Unknown command") + b"\r\n->"
            if starts and self._pace is None:
                self._pace = SteadyRate(_RATE_HZ, now_ns)
        return self._step(answer)

    def _message(self, instant_ns: int) -> bytes:
        distance_mm = self._read(instant_ns)[0] + self._gauge.zero_mm
        x = (distance_mm / self._gauge.range_mm * 100 + 1) * 65520 / 102
        good = math.isfinite(x) and 0 <= round(x) <= 65520
        code = round(x) if good else _NO_PEAK
        self.sent -= not good  # errors do not count as readings
        return bytes(tag << 6 | code >> 6 * tag & 0x3F for tag in (_LOW, _MIDDLE, _HIGH))
