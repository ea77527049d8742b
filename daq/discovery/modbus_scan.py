"""Search for the unit, registers and byte order of a Modbus gauge with a wrong rig file.

While the user moves the probe, every unit is polled, then the registers around the configured address, also in manual
notation (30203, 40203). A value that moves steadily within the range of a gauge is the reading or its upper part. The
candidates with the fewest changes to the rig file are chosen.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from daq import clock
from daq.acquisition.streams import Stream, streams_of
from daq.discovery.cell_finding import CellFinding, doubtful, ok, wrong
from daq.discovery.trial import USUAL_LINES
from daq.protocol.conversation import Fault
from daq.protocol.modbus import Wire, exception_of, registers_of, unpack
from daq.protocol.numerals import is_length
from daq.wire.links import Link, LinkLost
from rigs.errors import CellError
from rigs.rig import Rig
from rigs.schema.modbus import ModbusMap, Number, Order, Register
from rigs.schema.probe import MM_PER_UNIT

LIKELY_MM = 100.0
"""Range of the longest probes, for gauges without `range_mm`."""
_FEW = 5
"""Minimum number of different readings."""
_RANDOM = 0.5
"""Limit of the mean square step over twice the variance (von Neumann): 1 for random numbers, 0.2 for ten readings of a
motion."""
_CUT = 2**-4
"""Part of a number in its first register: four bits of the fraction in double precision."""
_LEVELS = np.linspace(0, 1, 9)
_SELDOM = {"value.type": 3}
"""Weight of a change of a key that is seldom wrong."""

Place = tuple[int, int]
"""Unit and function."""
Piece = tuple[int, int]
"""First register and number of registers of a read. A number must not span two reads."""
Seen = Mapping[int, Sequence[int]]
"""Register contents by address, for each pass."""


@dataclass(frozen=True)
class ValueDecoding:
    changed: dict[str, Any]
    """Keys that differ from the rig file."""
    readings_mm: NDArray[np.float64]
    moving: frozenset[tuple[int, int, int]]
    """Unit, function and address of the registers that changed."""

    @property
    def effort(self) -> int:
        """Number of errors in the rig file implied by this decoding."""
        return sum(_SELDOM.get(key, 1) for key in self.changed)

    def is_part_of(self, way: ValueDecoding) -> bool:
        """True if this is the upper part of another number: the same motion, truncated.

        Registers may be read one after the other, so only the distributions are compared.
        """
        apart_mm = np.abs(np.quantile(self.readings_mm, _LEVELS) - np.quantile(way.readings_mm, _LEVELS)).mean()
        return self.moving < way.moving and bool(apart_mm <= _CUT * np.abs(way.readings_mm).max())

    def __str__(self) -> str:
        return ", ".join(f"{key}: {value}" for key, value in self.changed.items())


def likely_decodings(gauge: ModbusMap, seen: Mapping[tuple[Place, Piece], Seen]) -> list[ValueDecoding]:
    of_pieces = [way for (place, _), registers in seen.items() for way in _decodings_of(gauge, *place, registers)]
    moving = {str(way): way for way in of_pieces}.values()
    whole = [way for way in moving if not any(way.is_part_of(wider) for wider in moving)]
    return sorted(whole, key=lambda way: way.effort)


def _decodings_of(gauge: ModbusMap, unit: int, function: int, seen: Seen) -> Iterator[ValueDecoding]:
    orders = product(get_args(Order), repeat=2)
    for address, kind, (word_order, byte_order) in product(seen, get_args(Number), list(orders)):
        register = Register(address=address, type=kind)
        if register.count == 1 and word_order != gauge.word_order:
            continue
        if not all(address + k in seen for k in range(register.count)):
            continue
        settings = {
            "unit": (unit, gauge.unit),
            "function": (function, gauge.function),
            "value.address": (address, gauge.value.address),
            "value.type": (kind, gauge.value.type),
            "word_order": (word_order, gauge.word_order),
            "byte_order": (byte_order, gauge.byte_order),
        }
        layout = gauge.model_copy(update={"address": address, "word_order": word_order, "byte_order": byte_order})
        passes = zip(*(seen[address + k] for k in range(register.count)), strict=True)
        raw = np.array([unpack(words, register, layout) for words in passes], dtype=float)
        with np.errstate(over="ignore", invalid="ignore"):  # a wrong byte order may give infinity or nan
            readings_mm = (raw * gauge.value.scale + gauge.value.offset) * MM_PER_UNIT[gauge.units]
        if is_motion(readings_mm, gauge):
            changed = {key: read for key, (read, written) in settings.items() if read != written}
            moving = [address + k for k in range(register.count) if len(set(seen[address + k])) > 1]
            yield ValueDecoding(changed, readings_mm, frozenset((unit, function, place) for place in moving))


def is_motion(readings_mm: NDArray[np.float64], gauge: ModbusMap) -> bool:
    """True if readings (n,) are plausible for this gauge while the probe is moved to and fro."""
    lowest_mm, highest_mm = gauge.limits_mm or (-LIKELY_MM, LIKELY_MM)
    if not all(map(is_length, readings_mm.tolist())):
        return False
    if readings_mm.min() < lowest_mm or readings_mm.max() > highest_mm or len(np.unique(readings_mm)) < _FEW:
        return False
    return bool(np.mean(np.diff(readings_mm) ** 2) < 2 * _RANDOM * np.var(readings_mm))


UNITS = range(1, 248)
_FIRST_UNITS = range(1, 17)
"""Common unit numbers at delivery, tried with other line settings."""
SWEEP_S, _LONGEST_SWEEP_S = 0.1, 60.0
"""Time for each unit, and limit for all. A gateway that refuses more slowly is heard during the next request."""
_AROUND = 8
"""Registers read before and after the configured one."""
_LONGEST = 4
"""Registers of the longest number."""
_BASES = (0, 30_001, 40_001, 300_001, 400_001)
"""Offsets added to the transmitted address in manuals to denote the kind of register."""
_PASSES, PASS_S = 40, 0.1
_NO_PATH = (10, 11)
"""Exceptions with which a gateway reports an absent unit."""
_SILENCE_S = 0.004
"""Twice the silence between frames at 19 200 baud."""


@dataclass
class Asker:
    link: Link
    wire: Wire
    heard: set[int] = field(default_factory=set)
    """Units that responded, even with a refusal."""

    def read(self, place: Place, piece: Piece, timeout_s: float) -> tuple[int, ...] | None:
        unit, function = place
        clock.sleep(0.0 if self.wire.numbered else _SILENCE_S)
        while self.link.read(0.0):
            pass
        self.wire.frames.clear()
        request = self.wire.numbering(self.wire.request(unit, function, *piece))
        self.link.write(request)
        until = clock.now_s() + timeout_s
        while (left_s := until - clock.now_s()) > 0:
            for message in self.wire.frames.feed(self.link.read(left_s), clock.now_ns()):
                if isinstance(message, Fault) or self.wire.asks(message.data) is not None:
                    continue
                answering, number, content = self.wire.open(message.data)
                refused = exception_of(content)
                if content and refused not in _NO_PATH:
                    self.heard.add(answering)
                if answering != unit or (self.wire.numbered and number != int.from_bytes(request[:2], "big")):
                    continue
                registers = registers_of(content)
                return registers if registers is None or len(registers) == piece[1] else None
        return None


def scan_modbus(rig: Rig, say: Callable[[str], None]) -> Iterator[CellFinding]:
    gauges = {name: gauge for name, gauge in rig.gauges if isinstance(gauge, ModbusMap)}
    if not gauges:
        yield doubtful("scan", "the rig file has no gauge with interface modbus_map", "give a rig with Modbus gauges")
    for stream in streams_of(rig):
        for name in (column.removesuffix("_mm") for column in stream.columns):
            if name in gauges:
                yield scan_gauge(name, gauges[name], stream, say)


def scan_gauge(name: str, gauge: ModbusMap, stream: Stream, say: Callable[[str], None]) -> CellFinding:
    say(f"{name}: querying all unit addresses on {stream.port}, for up to half a minute")
    lines = [stream.line]
    if stream.port.startswith("/"):
        lines += [line for line in USUAL_LINES if line != stream.line]
    for line in lines:
        try:
            link = replace(stream, line=line).open()
        except CellError as error:
            return wrong(name, f"{stream.port}: {error.what}", error.remedy)
        with closing(link), suppress(LinkLost):
            asker = Asker(link, Wire(stream.port, gauge.framing, serving=False))
            units = UNITS if line == stream.line else _FIRST_UNITS
            until = clock.now_s() + _LONGEST_SWEEP_S
            for unit in (gauge.unit, *units):
                if clock.now_s() < until and unit not in asker.heard:
                    asker.read((unit, gauge.function), (gauge.value.address, gauge.value.count), SWEEP_S)
            if asker.heard:
                move = "move the probe to and fro now, about once a second, and no other"
                say(f"{name}: {move}; units: {_listed_units(asker)}")
                moving = likely_decodings(gauge, _read_passes(asker, gauge))
                return _judge_decodings(name, gauge, {} if line == stream.line else {"line": line}, moving, asker)
    return wrong(name, f"{stream.port}: no Modbus unit answers", "check the cable, A and B exchanged, and the supply")


def _read_passes(asker: Asker, gauge: ModbusMap) -> dict[tuple[Place, Piece], dict[int, list[int]]]:
    pieces = [(place, piece) for unit in sorted(asker.heard) for place, piece in _readable(asker, gauge, unit)]
    seen: dict[tuple[Place, Piece], list[tuple[int, ...]]] = {piece: [] for piece in pieces}
    for _ in range(_PASSES):
        began = clock.now_s()
        for place, piece in pieces:
            if registers := asker.read(place, piece, gauge.timeout_s):
                seen[place, piece].append(registers)
        clock.sleep(max(0.0, began + PASS_S - clock.now_s()))
    return {
        key: {key[1][0] + k: list(values) for k, values in enumerate(zip(*read, strict=True))}
        for key, read in seen.items()
    }


def _readable(asker: Asker, gauge: ModbusMap, unit: int) -> Iterator[tuple[Place, Piece]]:
    """Readable blocks of this unit: complete windows, or single values if a window is refused."""
    for function in (3, 4):
        place = (unit, function)
        for middle in (gauge.value.address - base for base in _BASES if gauge.value.address >= base):
            first = max(0, middle - _AROUND)
            window = (first, middle + _AROUND + _LONGEST - first)
            if asker.read(place, window, gauge.timeout_s):
                yield place, window
                continue
            for address in range(first, middle + _AROUND + 1):
                sizes = sorted({_LONGEST, gauge.value.count}, reverse=True)
                yield from ((place, (address, n)) for n in sizes if asker.read(place, (address, n), gauge.timeout_s))


def _judge_decodings(
    name: str, gauge: ModbusMap, line: dict[str, object], moving: list[ValueDecoding], asker: Asker
) -> CellFinding:
    if not moving:
        around = f"registers {gauge.value.address} ± {_AROUND}"
        observation = f"units {_listed_units(asker)} answer, but no value in {around} moves like a probe"
        remedy = "move the probe during the scan; check `range_mm`, and the address in the manual"
        return doubtful(name, observation, remedy)
    best, *others = moving
    span = f"{best.readings_mm.min():.4f} to {best.readings_mm.max():.4f} mm"
    if rivals := [way for way in others if way.effort == best.effort]:
        choices = "; or ".join(str(way) or "as described" for way in (best, *rivals))
        return doubtful(name, f"several values move: {choices}", "repeat the scan, and move only this probe")
    changed = line | best.changed
    if not changed:
        return ok(name, f"matches the rig file; the value moves from {span}")
    words = ", ".join(f"{key}: {value}" for key, value in changed.items())
    return wrong(name, f"moves from {span} with {words}, which differs from the rig file", f"write {words}")


def _listed_units(asker: Asker) -> str:
    return ", ".join(map(str, sorted(asker.heard)))
