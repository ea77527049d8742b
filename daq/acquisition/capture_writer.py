"""Capture of the raw bytes of all links while the daemon runs, and the marks of a replay.

Readers never wait for the disk; the file contains the number of dropped pieces. The capture ends with a log message
when it reaches `LARGEST` bytes or the disk fails.
"""

from __future__ import annotations

import logging
import re
import threading
from collections import Counter, deque
from collections.abc import Sequence
from pathlib import Path
from typing import TextIO

from daq import clock
from daq.acquisition.streams import Stream
from daq.protocol.conversation import Fault, FaultKind
from daq.wire.capture import HEAD, MOST_BYTES, CaptureMark, Piece
from daq.wire.conversation_loop import ByteLink
from rigs.errors import FileError
from rigs.files import read_from

log = logging.getLogger("rigd")
LARGEST = 9 * MOST_BYTES // 10
"""The limit of `rig replay`, with a margin for the last write."""
_ROOM = 200_000
"""Pieces buffered for a stalled disk: several minutes at 500 Hz."""
_WRITE_S = 0.5


class CaptureWriter(clock.StoppableThread):
    def __init__(self, path: Path, streams: Sequence[Stream]) -> None:
        super().__init__("capture")
        self._path, self._streams = path, streams
        self._file: TextIO
        self._lock = threading.Lock()
        self._pieces: deque[Piece] = deque()
        self._left_out: Counter[str] = Counter()
        self._open = True
        self._size = 0

    def start(self) -> None:
        try:
            self._file = self._path.open("x", encoding="utf-8")
        except OSError as error:
            problem, remedy = error.strerror or str(error), "give --capture a different file"
            raise FileError(str(self._path), problem, remedy, code="output.not_writable") from None
        lines = [HEAD]
        for stream in self._streams:
            settings = f", {stream.line}" if stream.port.startswith("/") else ""
            lines.append(f"# stream {stream.name}: {stream.port}{settings}")
        self._size = self._file.write("".join(f"{line}\n" for line in lines))
        super().start()

    def captured(self, stream: str, link: ByteLink) -> ByteLink:
        return _CapturedLink(self, stream, link)

    def add(self, stream: str, mark: CaptureMark, data: bytes) -> None:
        piece = Piece(clock.now_ns(), stream, mark, data)
        with self._lock:
            if self._open and len(self._pieces) < _ROOM:
                self._pieces.append(piece)
            elif self._open:
                self._left_out[stream] += 1

    def finish(self, within_s: float) -> None:
        """Write the remaining pieces and close the file. After `within_s`, the capture is truncated."""
        self.stop()
        self.join(within_s)
        if self.is_alive():
            log.error("capture %s ends early: the disk does not accept the rest", self._path)

    def run(self) -> None:
        while not self._stop_asked.wait(_WRITE_S):
            self._write()
        self._write()
        self._end("")

    def _write(self) -> None:
        with self._lock:
            pieces = list(self._pieces)
            self._pieces.clear()
            now_ns = clock.now_ns()
            pieces += [Piece(now_ns, name, CaptureMark.LEFT_OUT, str(n).encode()) for name, n in self._left_out.items()]
            self._left_out.clear()
        if not self._open:
            return
        try:
            self._size += self._file.write("".join(f"{piece.line()}\n" for piece in pieces))
            self._file.flush()
        except OSError as error:
            self._end(f"{error.strerror or error}")
        if self._size >= LARGEST:
            self._end(f"it has grown to {LARGEST / 1e9:g} GB; restart rigd with a different file to go on")

    def _end(self, why: str) -> None:
        with self._lock:
            if not self._open:
                return
            self._open = False
            self._pieces.clear()
        try:
            self._file.close()
        except OSError as error:
            why = why or f"{error.strerror or error}"
        if why:
            log.error("capture %s ended: %s", self._path, why)


class _CapturedLink:
    def __init__(self, writer: CaptureWriter, stream: str, link: ByteLink) -> None:
        self._writer, self._stream, self._link = writer, stream, link

    def read(self, timeout_s: float) -> bytes:
        data = self._link.read(timeout_s)
        if data:
            self._writer.add(self._stream, CaptureMark.CAME, data)
        return data

    def write(self, data: bytes) -> None:
        self._writer.add(self._stream, CaptureMark.SENT, data)
        self._link.write(data)

    def set_dtr(self, on: bool) -> None:
        self._link.set_dtr(on)


_LINE = re.compile(r"(\S+) ([+-][0-9.]+)")
_MOST_BYTES = 1_000_000
"""Bytes per read. The file grows by about 20 bytes per second and stream."""


def out_of_step_line(stream: str, off_ns: float) -> str:
    return f"{stream} {off_ns / 1e6:+.1f}\n"


class ReplayMarks:
    """Reader of the file in which `rig replay` marks each second that was out of step (`replay:` in the rig file).

    Each line becomes a fault of that stream in the current run, which is excluded from evaluation.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._end = 0

    def skip(self) -> None:
        before = -1
        while before < self._end:
            before = self._end
            self._lines()

    def read_new(self) -> list[tuple[str, Fault]]:
        marks = []
        for line in filter(None, map(_LINE.fullmatch, self._lines())):
            detail = f"the replay was {line[2]} ms out of step for a second; use a less busy computer"
            marks.append((line[1], Fault(FaultKind.OUT_OF_STEP, clock.now_ns(), detail)))
        return marks

    def _lines(self) -> list[str]:
        """Complete new lines, up to the limit of a call. Empty if the file is gone."""
        try:
            data, size = read_from(self._path, self._end, _MOST_BYTES)
        except (OSError, FileError):
            return []
        if size < self._end:  # a replay truncates the file at the start
            self._end = 0
            return self._lines()
        complete, newline, incomplete = data.rpartition(b"\n")
        # Data of this length without a line end cannot be a mark.
        self._end += len(data) if len(incomplete) == _MOST_BYTES else len(complete + newline)
        return complete.decode(errors="replace").split("\n")
