"""A capture: the raw bytes of every link, each piece with its stamp, in a file that a person can read.

    # rig capture 1
    # stream g1: /dev/ttyUSB0, 4800 7E2
    81273645120938 g1 + /dev/ttyUSB0
    81273645204411 g1 > ?\\r
    81273690012874 g1 < +00.12
    81273690013020 g1 - the device was unplugged

`>` was sent, `<` came, `+` the link opened, `-` it was lost, `!` so many pieces found no room. Bytes that do not print
are written as Python writes them. A piece is what one read or write of the system carried; nothing is cut or joined.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from rigs.errors import FileError
from rigs.files import read_bytes

HEAD = "# rig capture 1"
MOST_BYTES = 1_000_000_000
"""Largest capture that is read. An hour of three busy streams has 0.5 GB."""
_LINE = re.compile(r"(\d{1,19}) (\S{1,64}) ([><+!-]) (.*)")


class Mark(StrEnum):
    """The kind of a line in a capture."""

    SENT = ">"
    CAME = "<"
    OPENED = "+"
    LOST = "-"
    LEFT_OUT = "!"


@dataclass(frozen=True, slots=True)
class Piece:
    """Something that happened on the link of a stream. at_ns: of the host's monotonic clock, before a write, after a
    read. data: the bytes, or for the other marks a text in ASCII."""

    at_ns: int
    stream: str
    mark: Mark
    data: bytes

    def line(self) -> str:
        """Return the piece as a line of the file."""
        return f"{self.at_ns} {self.stream} {self.mark} {self.data.decode('latin-1').encode('unicode_escape').decode()}"


@dataclass(frozen=True)
class Capture:
    """The content of a capture file. pieces: in order. cut: whether it ends within a line, as after a crash."""

    pieces: tuple[Piece, ...]
    cut: bool

    @property
    def streams(self) -> tuple[str, ...]:
        """The names of the streams with any pieces, in order of their first piece."""
        return tuple(dict.fromkeys(piece.stream for piece in self.pieces))

    def of(self, stream: str) -> tuple[Piece, ...]:
        """Return the pieces of one stream."""
        return tuple(piece for piece in self.pieces if piece.stream == stream)


def read_capture(path: Path) -> Capture:
    """Read a capture file. Raises FileError that names the first line that cannot be read."""
    try:
        text = read_bytes(path, MOST_BYTES).decode()
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "no text"
        raise FileError(str(path), reason, "give the file that rigd --capture wrote") from None
    if not text.startswith(HEAD):
        raise FileError(str(path), "is not a capture written by rigd", f"one begins with {HEAD!r}: rigd --capture FILE")
    lines = text.split("\n")
    cut = lines.pop() != ""
    pieces = list[Piece]()
    for number, line in enumerate(lines, 1):
        if line.startswith("#"):
            continue
        try:
            match = _LINE.fullmatch(line)
            if match is None:
                raise ValueError("no piece")
            data = match[4].encode("ascii").decode("unicode_escape").encode("latin-1")
            pieces.append(Piece(int(match[1]), match[2], Mark(match[3]), data))
        except ValueError:
            problem = f"line {number} cannot be read as part of a capture: {line[:40]!r}"
            raise FileError(str(path), problem, "correct or delete that line") from None
    return Capture(tuple(pieces), cut)
