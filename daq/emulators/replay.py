"""Replay of a captured cell for the real daemon: every instrument on a pty or local port.

All instruments share a timebase, so gauges and robot keep the relative timing. Deviations are counted and written for
rigd to a file named in the rig file, which marks the run.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path

import yaml

from daq import clock
from daq.acquisition.capture_writer import out_of_step_line
from daq.acquisition.streams import ROBOT, Stream, streams_of
from daq.emulators.emulated_cell import EmulatedInstruments
from daq.emulators.played import AnsweringPlayer, Exchanges, StreamingPlayer
from daq.emulators.timebase import Steps, Timebase, bearable_ns, u_asked_ns, u_cycle_ns
from daq.protocol.bus import Bus
from daq.protocol.polled import Polled
from daq.wire.capture import Capture, CaptureMark, Piece
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.links import tcp_address, udp_address
from rigs.yaml_text import data_of

_OVER_NS = 5_000_000_000
"""Time after the end of the capture at which the replay ends, even if data has not been fetched."""

Player = StreamingPlayer | AnsweringPlayer


class Replay:
    def __init__(
        self,
        rig: Rig,
        capture: Capture,
        marks: Path | None = None,
        *,
        opening: Callable[..., EmulatedInstruments] = EmulatedInstruments,
    ) -> None:
        streams, self._time = streams_of(rig), Timebase()
        heard = {stream.name: capture.of(stream.name) for stream in streams}
        for name, pieces in heard.items():
            if not any(piece.mark is CaptureMark.CAME for piece in pieces):
                problem = (
                    f"the capture contains no data of {name} (it contains {', '.join(capture.streams) or 'nothing'})"
                )
                raise FileError(rig.name, problem, "give the rig file used for the capture", code="readings.unsuitable")
        u_ns = {stream.name: _u_ns(stream, heard[stream.name]) for stream in streams}
        may_ns = bearable_ns([u for name, u in u_ns.items() if name != ROBOT], u_ns[ROBOT])
        self._marks = marks.absolute() if marks else None
        if self._marks:
            self._marks.write_text("", encoding="utf-8")
        self.unmarked = ""
        """Why a mark could not be written, which ends the replay."""
        self.steps = {
            stream.name: Steps(may_ns, asked=_is_asked(stream), out_of_step=partial(self._mark, stream.name))
            for stream in streams
        }
        self._replayed = {
            stream.name: _replayed(stream, heard[stream.name], self._time, self.steps[stream.name])
            for stream in streams
        }
        # A long capture consists of a million permanent objects. Garbage collection among them would occasionally stop
        # all instruments for 0.1 s.
        gc.collect()
        gc.freeze()
        self._end_ns = max((piece.at_ns for piece in capture.pieces), default=0)
        self.cell = opening(rig, self._replayed, paced=False)

    @property
    def is_finished(self) -> bool:
        shift_ns = self._time.shift_ns
        over = shift_ns is not None and clock.now_ns() > shift_ns + self._end_ns + _OVER_NS
        return over or bool(self.unmarked) or all(heard.is_finished for heard in self._replayed.values())

    @property
    def restarts(self) -> int:
        return self._time.turn

    @property
    def otherwise(self) -> int:
        return sum(steps.otherwise for steps in self.steps.values())

    def rig_text(self, text: str) -> str:
        data = data_of(self.cell.rig_text(text)) | ({"replay": str(self._marks)} if self._marks else {})
        written: str = yaml.safe_dump(data, sort_keys=False, allow_unicode=True, width=110)
        return written

    def _mark(self, stream: str, off_ns: float) -> None:
        if self._marks is None:
            return
        try:
            with self._marks.open("a", encoding="utf-8") as file:
                file.write(out_of_step_line(stream, off_ns))
        except OSError as error:
            self.unmarked = error.strerror or str(error)


class ReplayedStream:
    """Connections of a stream in the capture. Call it to obtain the player of the next connection.

    If the host closes a connection early, all streams restart; otherwise this stream would lose the synchronisation.
    """

    def __init__(self, connections: Sequence[Callable[[], Player]], over: Callable[[], Player], time: Timebase) -> None:
        self._connections, self._over, self._time = connections, over, time
        self._turn = -1
        self._number = 0
        self._playing = over()

    @property
    def is_finished(self) -> bool:
        return (
            self._turn == self._time.turn and self._playing.is_finished and self._number >= len(self._connections) - 1
        )

    def __call__(self) -> Player:
        """Player of the next connection. A player closed by the host before sending is reused."""
        if self._turn == self._time.turn:
            if self._playing.is_finished:
                self._number += 1
            elif self._playing.begun:
                self._time.restart(self._turn)
        if self._turn != self._time.turn:
            self._turn, self._number = self._time.turn, 0
        remaining = self._number < len(self._connections)
        self._playing = self._connections[self._number]() if remaining else self._over()
        return self._playing


def _replayed(stream: Stream, pieces: Sequence[Piece], time: Timebase, steps: Steps) -> ReplayedStream:
    hangs_up = tcp_address(stream.port) is not None
    calls = udp_address(stream.port) is not None and stream.listens
    connections: list[Callable[[], Player]] = [
        partial(AnsweringPlayer, Exchanges.of(connection), time, steps, hangs_up=hangs_up)
        if _is_asked(stream)
        else partial(StreamingPlayer, connection, time, steps, hangs_up=hangs_up, calls=calls)
        for connection in _connections(stream, pieces)
    ]
    return ReplayedStream(connections, partial(StreamingPlayer, (), time, steps, hangs_up=hangs_up, calls=False), time)


def _is_asked(stream: Stream) -> bool:
    return isinstance(stream.host(), Polled | Bus)


def _u_ns(stream: Stream, pieces: Sequence[Piece]) -> float:
    """Standard uncertainty of the times of a captured stream, as in the analysis."""
    if _is_asked(stream):
        return u_asked_ns(pieces)
    if stream.name == ROBOT or not stream.port.startswith("/"):
        return u_cycle_ns(pieces)
    return stream.line.character_ns / 3**0.5


def _connections(stream: Stream, pieces: Sequence[Piece]) -> Iterable[Sequence[Piece]]:
    """Pieces of each connection that contains data. Only TCP connections can be distinguished."""
    if not tcp_address(stream.port):
        return [pieces]
    connections: list[list[Piece]] = []
    for piece in pieces:
        if piece.mark is CaptureMark.OPENED or not connections:
            connections.append([])
        connections[-1].append(piece)
    return [connection for connection in connections if any(piece.mark is CaptureMark.CAME for piece in connection)]
