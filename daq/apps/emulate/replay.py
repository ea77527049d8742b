"""A captured cell: every instrument of a capture on a pty or a local port again, for the real daemon.

All instruments share one timebase (`daq.apps.emulate.timebase`), so that gauges and robot are to each other as they
were. What cannot be kept in step is counted, and written for rigd into a file that the rig file names: the run is
marked.
When a stream's pieces are played the instrument falls silent (serial) or hangs up (TCP).
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import yaml

from daq import clock
from daq.acquisition.capture_writer import out_of_step_line
from daq.acquisition.streams import ROBOT, Stream, streams_of
from daq.apps.emulate.emulated_cell import Cell
from daq.apps.emulate.played import AnsweringPlayer, Exchanges, StreamingPlayer
from daq.apps.emulate.timebase import Steps, Timebase, bearable_ns, u_asked_ns, u_cycle_ns
from daq.protocol.bus import Bus
from daq.protocol.polled import Polled
from daq.wire.capture import Capture, Mark, Piece
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.links import tcp_address, udp_address
from rigs.yaml_text import data_of

_OVER_NS = 5_000_000_000
"""So long after the end, what is left is not fetched any more."""

Player = StreamingPlayer | AnsweringPlayer


class Replay:
    """The instruments of a rig as they were captured, in a `cell` to start and to stop."""

    @classmethod
    def open(
        cls, rig: Rig, capture: Capture, marks: Path | None = None, *, opening: Callable[..., Cell] = Cell.open
    ) -> Replay:
        """Open the ports of a capture. marks: the file that records what is out of step; None if it is not wanted.
        opening: what opens the cell, with the arguments of `Cell.open`.

        Raises FileError where the capture holds nothing of a stream of the rig, OSError where the file cannot be made.
        """
        streams, timebase = streams_of(rig), Timebase()
        heard = {stream.name: capture.of(stream.name) for stream in streams}
        for name, pieces in heard.items():
            if not any(piece.mark is Mark.CAME for piece in pieces):
                problem = f"the capture holds nothing of {name} (it has {', '.join(capture.streams) or 'nothing'})"
                raise FileError(rig.name, problem, "give the rig file that it was captured with")
        may_ns = bearable_ns(
            [_u_ns(stream, heard[stream.name]) for stream in streams if stream.name != ROBOT],
            *(_u_ns(stream, heard[stream.name]) for stream in streams if stream.name == ROBOT),
        )
        marked = Marks(marks.absolute() if marks else None)
        marked.begin()
        steps = {
            stream.name: Steps(may_ns, asked=_is_asked(stream), out_of_step=partial(marked.add, stream.name))
            for stream in streams
        }
        replayed = {
            stream.name: _replayed(stream, heard[stream.name], timebase, steps[stream.name]) for stream in streams
        }
        # A long capture is a million objects that stay: looking for garbage among them would stop every instrument for
        # a tenth of a second now and then.
        gc.collect()
        gc.freeze()
        end_ns = max((piece.at_ns for piece in capture.pieces), default=0)
        return cls(opening(rig, replayed, paced=False), timebase, end_ns, replayed, steps, marked)

    def __init__(
        self,
        cell: Cell,
        timebase: Timebase,
        end_ns: int,
        replayed: Mapping[str, ReplayedStream],
        steps: Mapping[str, Steps],
        marks: Marks,
    ) -> None:
        """end_ns: the time of the last piece; steps: how well each stream keeps its time."""
        self.cell, self.steps = cell, steps
        self._time, self._end_ns, self._replayed, self._marks = timebase, end_ns, replayed, marks

    @property
    def unmarked(self) -> str:
        """Why a mark could not be written: the replay then ends, since what is out of step could not be recorded."""
        return self._marks.failure

    @property
    def done(self) -> bool:
        """Whether everything has been played."""
        over = self._time.is_past(clock.now_ns(), self._end_ns + _OVER_NS)
        return over or bool(self.unmarked) or all(heard.done for heard in self._replayed.values())

    @property
    def restarts(self) -> int:
        """How often everything restarted because the host left a connection before its end."""
        return self._time.turn

    @property
    def otherwise(self) -> int:
        """The number of pieces that the host sent differently from the capture."""
        return sum(steps.otherwise for steps in self.steps.values())

    def rig_text(self, text: str) -> str:
        """Return the rig file's text with the ports of this cell and the file that says what is out of step."""
        data = data_of(self.cell.rig_text(text)) | ({"replay": str(self._marks.path)} if self._marks.path else {})
        written: str = yaml.safe_dump(data, sort_keys=False, allow_unicode=True, width=110)
        return written


@dataclass
class Marks:
    """The file that records what is out of step, if one is wanted; `failure` says why a mark could not be written."""

    path: Path | None
    failure: str = ""

    def begin(self) -> None:
        """Empty the file. Raises OSError."""
        if self.path is not None:
            self.path.write_text("", encoding="utf-8")

    def add(self, stream: str, off_ns: float) -> None:
        """Record that a stream was out of step for a second, by this much."""
        if self.path is None:
            return
        try:
            with self.path.open("a", encoding="utf-8") as file:
                file.write(out_of_step_line(stream, off_ns))
        except OSError as error:
            self.failure = error.strerror or str(error)


class ReplayedStream:
    """What one stream sent in the capture, one connection after the other; called for the device of the next one.

    When the host leaves a connection before its end, everything restarts for all streams: else this one would be
    out of step with them.
    """

    def __init__(self, connections: Sequence[Callable[[], Player]], over: Callable[[], Player], time: Timebase) -> None:
        """What makes the player of each connection, and of those that come when all is played."""
        self._connections, self._over, self._time = connections, over, time
        self._turn = -1
        self._number = 0
        self._playing = over()

    @property
    def done(self) -> bool:
        """Whether the last connection has been played."""
        return self._turn == self._time.turn and self._playing.done and self._number >= len(self._connections) - 1

    def __call__(self) -> Player:
        """Return the player of the next connection; one that the host left before anything was sent is kept."""
        if self._turn == self._time.turn:
            if self._playing.done:
                self._number += 1
            elif self._playing.begun:
                self._time.restart(self._turn)
        if self._turn != self._time.turn:
            self._turn, self._number = self._time.turn, 0
        remaining = self._number < len(self._connections)
        self._playing = self._connections[self._number]() if remaining else self._over()
        return self._playing


def _replayed(stream: Stream, pieces: Sequence[Piece], time: Timebase, steps: Steps) -> ReplayedStream:
    """Return what plays a stream."""
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
    """Standard uncertainty of the time of what a captured stream says, as the analysis has it."""
    if _is_asked(stream):
        return u_asked_ns(pieces)
    if stream.name == ROBOT or not stream.port.startswith("/"):
        return u_cycle_ns(pieces)
    return stream.line.character_ns / 3**0.5


def _connections(stream: Stream, pieces: Sequence[Piece]) -> Iterable[Sequence[Piece]]:
    """The pieces of each time that the link was open and something came; only over TCP can they be distinguished."""
    if not tcp_address(stream.port):
        return [pieces]
    connections: list[list[Piece]] = []
    for piece in pieces:
        if piece.mark is Mark.OPENED or not connections:
            connections.append([])
        connections[-1].append(piece)
    return [connection for connection in connections if any(piece.mark is Mark.CAME for piece in connection)]
