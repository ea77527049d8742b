"""A captured cell: every instrument of a capture on a pty or a local port again, for the real daemon.

An instrument says what it said then, at the pace at which it said it. Where the host had spoken first it waits until as
many bytes have come, since an answer belongs to its question and not to a time of day; whether they are the same bytes
is counted. When a stream's pieces are played the instrument falls silent (serial) or hangs up (TCP).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence

from daq.capture import Capture, Mark, Piece
from daq.emulators.cell import Cell
from daq.protocol.conversation import Device, Step
from daq.streams import Stream, streams_of
from rigs.errors import FileError
from rigs.links import tcp_address
from rigs.rig import Rig


class Replay:
    """The instruments of a rig as a capture heard them, in a `cell` to start and to stop.

    Raises FileError where the capture holds nothing of a stream of the rig.
    """

    def __init__(self, rig: Rig, capture: Capture) -> None:
        self._heard = {stream.name: _heard(rig, stream, capture) for stream in streams_of(rig)}
        self.cell = Cell(rig, self._heard)

    @property
    def done(self) -> bool:
        """Whether everything is played."""
        return all(heard.done for heard in self._heard.values())

    @property
    def otherwise(self) -> int:
        """Pieces that the host sent otherwise than it was captured."""
        return sum(heard.otherwise for heard in self._heard.values())


class Heard:
    """What one stream was heard to say, a connection after the other; called for the device of the next one."""

    def __init__(self, connections: Iterable[Sequence[Piece]]) -> None:
        self._waiting = deque(connections)
        self._ended = 0
        self._playing = Played(())

    @property
    def done(self) -> bool:
        """Whether the last of them is played."""
        return self._playing.done and not self._waiting

    @property
    def otherwise(self) -> int:
        """See `Replay`."""
        return self._ended + self._playing.otherwise

    def __call__(self) -> Device:
        """A connection that was lost before its end, as where the daemon was not there yet, begins again."""
        if not self._playing.done:
            self._playing = Played(self._playing.pieces)
        elif self._waiting:
            self._ended += self._playing.otherwise
            self._playing = Played(self._waiting.popleft())
        return self._playing


class Played:
    """The device's side of one connection, from its pieces."""

    def __init__(self, pieces: Sequence[Piece]) -> None:
        self.pieces = pieces
        self.sent = 0
        self.otherwise = 0
        self.done = not pieces
        self._pieces = deque(piece for piece in pieces if piece.mark in (Mark.SENT, Mark.CAME))
        self._at_ns = pieces[0].at_ns if pieces else 0
        self._now_ns = 0
        """When the piece before this was played; `_at_ns` in the capture."""
        self._heard = bytearray()

    def connected(self, now_ns: int) -> Step:
        self._now_ns = now_ns
        return self._play(now_ns)

    def received(self, data: bytes, now_ns: int) -> Step:
        if self._pieces:
            self._heard += data
        return self._play(now_ns)

    def tick(self, now_ns: int) -> Step:
        return self._play(now_ns)

    def _play(self, now_ns: int) -> Step:
        """At most one piece that came: over UDP each is a datagram of its own."""
        while self._pieces:
            piece = self._pieces[0]
            due_ns = self._now_ns + piece.at_ns - self._at_ns
            if piece.mark is Mark.SENT and len(self._heard) < len(piece.data):
                return Step()
            if piece.mark is Mark.CAME and now_ns < due_ns:
                return Step(wake_ns=due_ns)
            self._pieces.popleft()
            self._at_ns = piece.at_ns
            if piece.mark is Mark.CAME:
                self._now_ns = due_ns
                self.sent += 1
                return Step(piece.data, wake_ns=now_ns)
            self._now_ns = now_ns
            self.otherwise += self._heard[: len(piece.data)] != piece.data
            del self._heard[: len(piece.data)]
        self.done = True
        return Step(hang_up=True)


def _heard(rig: Rig, stream: Stream, capture: Capture) -> Heard:
    pieces = capture.of(stream.name)
    if not any(piece.mark is Mark.CAME for piece in pieces):
        what = f"the capture holds nothing of {stream.name} (it has {', '.join(capture.streams) or 'nothing'})"
        raise FileError(rig.name, what, "give the rig file that it was captured with")
    return Heard(connections(pieces) if tcp_address(stream.port) else [pieces])


def connections(pieces: Sequence[Piece]) -> list[list[Piece]]:
    """The pieces of each time that the link was open and something came."""
    found: list[list[Piece]] = []
    for piece in pieces:
        if piece.mark is Mark.OPENED or not found:
            found.append([])
        found[-1].append(piece)
    return [connection for connection in found if any(piece.mark is Mark.CAME for piece in connection)]
