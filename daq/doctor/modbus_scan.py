"""Finding what a Modbus gauge is, where the rig file describes it wrongly: its unit, its registers, their orders.

It is done by reading alone (functions 3 and 4), while a person moves the probe. First every unit number is asked; then
the registers around the described one, and where the number in a manual (30203, 40203) would have them, are read again
and again, and judged by `daq.doctor.modbus_ways`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from dataclasses import dataclass, field, replace

from daq import clock
from daq.acquisition.streams import Stream, streams_of
from daq.doctor.finding import Finding, doubtful, ok, wrong
from daq.doctor.modbus_ways import Piece, Place, Way, ways
from daq.doctor.trial import USUAL_LINES
from daq.protocol.conversation import Fault
from daq.protocol.modbus import Wire, exception_of, registers_of
from daq.wire.links import Link, LinkLost
from rigs.errors import CellError
from rigs.rig import Rig
from rigs.schema.modbus import ModbusMap

UNITS = range(1, 248)
_FIRST_UNITS = range(1, 17)
"""Numbers that most instruments are delivered with, or set to: tried at other line settings."""
SWEEP_S, _LONGEST_SWEEP_S = 0.1, 60.0
"""A unit answers within 0.1 s, or its answer is heard while the next is asked; a gateway may take longer to refuse."""
_AROUND = 8
"""Registers before and after the described one."""
_LONGEST = 4
"""Registers of the longest number."""
_BASES = (0, 30_001, 40_001, 300_001, 400_001)
"""What manuals add to the address on the wire, to say which kind of register it is."""
_PASSES, PASS_S = 40, 0.1
_NO_PATH = (10, 11)
"""Exceptions by which a gateway says that it has no such unit."""
_SILENCE_S = 0.004
"""Twice the silence between frames at 19 200 baud."""


@dataclass
class Asker:
    """Asks one thing after the other over a link. heard: units that have answered, if only by a refusal."""

    link: Link
    wire: Wire
    heard: set[int] = field(default_factory=set)

    def read(self, place: Place, piece: Piece, timeout_s: float) -> tuple[int, ...] | None:
        """Return the registers; None where they are refused or nothing comes. Raises LinkLost."""
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
                found, number, content = self.wire.open(message.data)
                refused = exception_of(content)
                if content and refused not in _NO_PATH:
                    self.heard.add(found)
                if found != unit or (self.wire.numbered and number != int.from_bytes(request[:2], "big")):
                    continue
                registers = registers_of(content)
                return registers if registers is None or len(registers) == piece[1] else None
        return None


def scan_modbus(rig: Rig, say: Callable[[str], None]) -> Iterator[Finding]:
    """Yield what each Modbus gauge of a rig is found to be. say: shows a person what to do now."""
    gauges = {name: gauge for name, gauge in rig.gauges if isinstance(gauge, ModbusMap)}
    if not gauges:
        yield doubtful("scan", "the rig file has no gauge of interface modbus_map", "scan a rig with Modbus gauges")
    for stream in streams_of(rig):
        for name in (column.removesuffix("_mm") for column in stream.columns):
            if name in gauges:
                yield scan_gauge(name, gauges[name], stream, say)


def scan_gauge(name: str, gauge: ModbusMap, stream: Stream, say: Callable[[str], None]) -> Finding:
    """Find one gauge, at the line settings of the rig file or else at others."""
    say(f"{name}: every unit number is asked on {stream.port}, for up to half a minute")
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
            _sweep(asker, gauge, UNITS if line == stream.line else _FIRST_UNITS)
            if asker.heard:
                say(f"{name}: move its probe to and fro now, about once a second, and no other; units: {_list(asker)}")
                seen = _watch(asker, gauge)
                return _finding(name, gauge, {} if line == stream.line else {"line": line}, ways(gauge, seen), asker)
    return wrong(name, f"{stream.port}: no Modbus unit answers", "check the cable, A and B exchanged, and its supply")


def _sweep(asker: Asker, gauge: ModbusMap, units: range) -> None:
    """Ask every unit for something; those that answer are heard."""
    until = clock.now_s() + _LONGEST_SWEEP_S
    for unit in (gauge.unit, *units):
        if clock.now_s() < until and unit not in asker.heard:
            asker.read((unit, gauge.function), (gauge.value.address, gauge.value.count), SWEEP_S)


def _watch(asker: Asker, gauge: ModbusMap) -> dict[tuple[Place, Piece], dict[int, list[int]]]:
    """What the registers around the described one hold, pass by pass."""
    pieces = [(place, piece) for unit in sorted(asker.heard) for place, piece in _readable(asker, gauge, unit)]
    seen: dict[tuple[Place, Piece], list[tuple[int, ...]]] = {piece: [] for piece in pieces}
    for _ in range(_PASSES):
        began = clock.now_s()
        for place, piece in pieces:
            if registers := asker.read(place, piece, gauge.timeout_s):
                seen[place, piece].append(registers)
        clock.sleep(max(0.0, began + PASS_S - clock.now_s()))
    return {
        key: {key[1][0] + k: list(held) for k, held in enumerate(zip(*read, strict=True))} for key, read in seen.items()
    }


def _readable(asker: Asker, gauge: ModbusMap, unit: int) -> Iterator[tuple[Place, Piece]]:
    """The pieces that this unit lets be read: whole windows, or where it refuses these single values."""
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


def _finding(name: str, gauge: ModbusMap, line: dict[str, object], found: list[Way], asker: Asker) -> Finding:
    """What was found, in words."""
    if not found:
        around = f"registers {gauge.value.address} ± {_AROUND}"
        what = f"units {_list(asker)} answer, but nothing in {around} moves like a probe"
        return doubtful(name, what, "move its probe during the scan; check `range_mm`, and the address in its manual")
    best, *others = found
    span = f"{best.readings_mm.min():.4f} to {best.readings_mm.max():.4f} mm"
    if rivals := [way for way in others if way.effort == best.effort]:
        choices = "; or ".join(str(way) or "as described" for way in (best, *rivals))
        return doubtful(name, f"several values move: {choices}", "scan again, and move this probe alone")
    changed = line | best.changed
    if not changed:
        return ok(name, f"as the rig file describes it, it moves from {span}")
    words = ", ".join(f"{key}: {value}" for key, value in changed.items())
    return wrong(name, f"moves from {span} with {words}, and not as the rig file describes it", f"write {words}")


def _list(asker: Asker) -> str:
    return ", ".join(map(str, sorted(asker.heard)))
