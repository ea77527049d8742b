"""Values that the emulated instruments measured and sent, stored independently of rig.

The readings of an instrument are numbered, and each value encodes its number: a gauge by its position on the way up and
down, a robot by the last digits of two joints. Each piece sent on a line records its readings, its time, and whether it
was changed. Each row of a run is compared with the pieces sent, and everything that the daemon read with the rows.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from daq import clock
from daq.acquisition.streams import ROBOT
from daq.emulators.simulated_cell import SimulatedLine
from rigs.rig import Rig
from rigs.schema.modbus import SolartronOrbit

_LOWEST_MM, _STEP_MM, _PLACES = 0.98, 0.02, 402
"""The steps are coarser than the last digit of any gauge. Where it turns round two digits change at once, for a reading
alone between two others of which one digit differs is doubted, and rightly."""
_STEP_DEG, _LEVELS = 5e-4, 32
"""Joints that tell numbers move by less than 0.02°, as do encoders of a robot that stands."""
_DRIVES_DEG_S = 4.0
_REACH = 600
"""Pieces among which a row's is sought: more than half of a gauge's way, on which no reading comes twice."""
_GREETINGS = {"opc_ua_robotics": 2, "micro_epsilon_ild1420": 1}
"""Messages with readings that begin a connection and are no rows: an OPC UA server answers a client that looks for its
nodes; of a sensor's stream of three-byte values the first shows where they begin."""
_TIED = 2_000_000
"""Stamps lie within so many ns of the arrival: a dozen threads may go on at one instant, each for up to 20 µs, and
several times."""


@dataclass
class Piece:
    """Bytes sent by an instrument in one write.

    readings: numbers, by column; broken: bytes were changed; late: it was delayed; greets: it answers the first request
    of a new connection, which precedes all readings.
    """

    at_ns: int
    readings: dict[str, list[int]]
    broken: bool
    late: bool
    greets: bool = False
    read_ns: int | None = None
    """When the daemon took it from its end."""

    @property
    def has_reading(self) -> bool:
        """True if it contains a reading of a gauge that was in range."""
        return any(number >= 0 for numbers in self.readings.values() for number in numbers)


@dataclass
class Instruments:
    """A motion that numbers its readings, and the ledger of what was sent.

    pieces: those with readings, of each stream, in order. in_two: streams whose every reading takes two messages.
    greets: the number of messages that begin each connection of a stream and are no rows. off: gauges whose heads are
    off; program: the robot's signal.
    """

    streams: dict[str, str] = field(default_factory=dict)
    """The stream of each column that tells numbers."""
    pieces: dict[str, list[Piece]] = field(default_factory=dict)
    in_two: set[str] = field(default_factory=set)
    greets: dict[str, int] = field(default_factory=dict)
    off: set[str] = field(default_factory=set)
    program: int = 0
    _count: dict[str, int] = field(default_factory=dict)
    _pending: dict[str, dict[str, list[int]]] = field(default_factory=dict)
    _stands_deg: float = 0.0
    _drives_since_ns: int | None = None

    @classmethod
    def of(cls, rig: Rig, streams: Sequence[str]) -> Instruments:
        made = cls()
        for stream in streams:
            made.pieces[stream] = []
            names = [ROBOT] if stream == ROBOT else [n for n in rig.gauges.recorded if n in stream.split("_")]
            device = rig.feedback if stream == ROBOT else rig.gauges.recorded[names[0]]
            made.greets[stream] = _GREETINGS.get(device.interface, 0)
            for name in names:
                made.streams[name] = stream
                if name != ROBOT and isinstance(rig.gauges.recorded[name], SolartronOrbit):
                    made.in_two.add(stream)
                made._count[name] = 0  # private _count, _pending: it is made here
            made._pending[stream] = {}
        return made

    def gauge_mm(self, name: str, now_ns: int) -> float:
        number = self._next(name)
        return math.nan if name in self.off else _LOWEST_MM + _STEP_MM * place_of(number)

    def joints_deg(self, now_ns: int) -> list[float]:
        high, low = divmod(self._next(ROBOT) % _LEVELS**2, _LEVELS)
        return [self._driven_deg(now_ns), 10.0, 20.0, 30.0, 40 + high * _STEP_DEG, 50 + low * _STEP_DEG]

    def signal(self, now_ns: int) -> float:
        return self.program

    def is_reading(self, stream: str) -> bool:
        """True if the instrument currently sends valid readings."""
        return bool(self._pending[stream])

    def drive(self, on: bool) -> None:
        """Let the robot drive on from here, or stand."""
        now_ns = clock.now_ns()
        self._stands_deg, self._drives_since_ns = self._driven_deg(now_ns), now_ns if on else None

    def attach(self, line: SimulatedLine) -> None:
        """Keep the ledger of a line."""
        connections: list[int] = []

        def sent(data: bytes, changed: bytes, at_ns: int, later_ns: int) -> Callable[[], None]:
            readings, self._pending[line.name] = self._pending[line.name], {}
            connections.extend([line.connections] * bool(readings))
            greets = connections.count(line.connections) <= self.greets[line.name]
            piece = Piece(at_ns, readings, changed != data, later_ns > 0, greets)
            if readings or piece.broken or piece.late:
                self.pieces[line.name].append(piece)

            def read() -> None:
                piece.read_ns = clock.now_ns()

            return read

        line.sent = sent

    def _driven_deg(self, now_ns: int) -> float:
        since_ns = self._drives_since_ns
        return self._stands_deg if since_ns is None else self._stands_deg + _DRIVES_DEG_S * (now_ns - since_ns) / 1e9

    def _next(self, name: str) -> int:
        number = self._count[name]
        self._count[name] += 1
        self._pending[self.streams[name]].setdefault(name, []).append(-1 if name in self.off else number)
        return number


def place_of(number: int) -> int:
    """Position of a gauge at a reading number: a triangular wave."""
    place = number % (2 * _PLACES - 2)
    return min(place, 2 * _PLACES - 2 - place)


def _code(name: str, number: int) -> int:
    return number % _LEVELS**2 if name == ROBOT else place_of(number)


def _shown(name: str, rows: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """The codes that rows show of an instrument, -1 for what it never shows; and which rows have its reading."""
    if name == ROBOT:
        high, low = (rows["q5_deg"] - 40) / _STEP_DEG, (rows["q6_deg"] - 50) / _STEP_DEG
        codes = np.round(high) * _LEVELS + np.round(low)
        off = np.maximum(abs(high - np.round(high)), abs(low - np.round(low)))
        good = (off < 0.2) & (np.round(high) >= 0) & (np.round(low) >= 0) & (np.round(high) < _LEVELS)
        good &= np.round(low) < _LEVELS
    else:
        places = (rows[f"{name}_mm"] - _LOWEST_MM) / _STEP_MM
        codes, off = np.round(places), abs(places - np.round(places))
        good = (off < 0.35) & (codes >= 0) & (codes < _PLACES)
    there = ~np.isnan(off)
    return np.where(good & there, codes, -1).astype(int), there


def held(name: str, rows: dict[str, Any], pieces: Sequence[Piece]) -> tuple[set[int], list[str]]:
    """Places of the pieces of its stream from which the rows of an instrument came, and what is wrong with rows."""
    places, arrivals = set[int](), [piece.at_ns for piece in pieces]
    codes, there = _shown(name, rows)
    stamps, first = rows["last_byte_ns"], rows["first_byte_ns"]
    last, wrong = (-1, -1), dict[str, list[Any]](invented=[], late=[], early=[], order=[])
    for row in np.flatnonzero(there).tolist():
        stamp_ns = int(stamps[row])
        place = bisect_right(arrivals, stamp_ns) - 1
        near = _near(name, int(codes[row]), pieces, place, last)
        if near is None:
            if not _spoilt(pieces, place):
                wrong["invented"].append(row)
            continue
        where, number = near
        late_ns = stamp_ns - arrivals[where]
        if pieces[where].broken or _spoilt(pieces, place):
            pass
        elif late_ns > _TIED:
            wrong["late"].append((row, late_ns / 1e6))
        elif late_ns < 0 or first[row] > stamp_ns:
            wrong["early"].append((row, late_ns / 1e6))
        elif (where, number) <= last:
            wrong["order"].append(row)
        else:
            last = where, number
        places.add(where)
    told = {
        "invented": "no instrument sent them",
        "late": "stamped late (row, ms)",
        "early": "stamped before they came (row, ms)",
        "order": "doubled or out of order",
    }
    return places, [f"{name}: {len(rows)} rows: {told[kind]}: {rows[:4]}" for kind, rows in wrong.items() if rows]


def _near(name: str, code: int, pieces: Sequence[Piece], place: int, last: tuple[int, int]) -> tuple[int, int] | None:
    """The piece and the reading that a row came from: the nearest that shows this code, one after the last if it may
    be."""
    for distance in range(_REACH):
        shown = [
            (where, number)
            for where in sorted({place - distance, place + distance})
            if 0 <= where < len(pieces)
            for number in pieces[where].readings.get(name, ())
            if number >= 0 and _code(name, number) == code
        ]
        if shown:
            return next((one for one in shown if one > last), shown[0])
    return None


def _spoilt(pieces: Sequence[Piece], place: int) -> bool:
    """True if a message received or completed at this time has changed bytes. Without a checksum such a message
    may
    have any content.
    """
    return any(pieces[where].broken for where in range(max(0, place - 2), min(len(pieces), place + 1)))
