"""Capture file: the raw bytes of every link with their timestamps, as readable text.

    # rig capture 1
    # stream g1: /dev/ttyUSB0, 4800 7E2
    81273645120938 g1 + /dev/ttyUSB0
    81273645204411 g1 > ?\\r
    81273690012874 g1 < +00.12
    81273690013020 g1 - the device was unplugged

`!` is the number of dropped pieces. A piece is the data of a single read or write, never split or joined.
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
"""Largest capture that can be read. An hour of three busy streams takes 0.5 GB."""
_LINE = re.compile(r"(\d{1,19}) (\S{1,64}) ([><+!-]) (.*)")


class CaptureMark(StrEnum):
    SENT = ">"
    CAME = "<"
    OPENED = "+"
    LOST = "-"
    LEFT_OUT = "!"


@dataclass(frozen=True, slots=True)
class Piece:
    at_ns: int
    """Monotonic time of the host, before a write or after a read."""
    stream: str
    mark: CaptureMark
    data: bytes
    """The bytes, or ASCII text for the other marks."""

    def line(self) -> str:
        return f"{self.at_ns} {self.stream} {self.mark} {self.data.decode('latin-1').encode('unicode_escape').decode()}"


@dataclass(frozen=True)
class Capture:
    pieces: tuple[Piece, ...]
    cut: bool
    """True if the file ends within a line, as after a crash."""

    @property
    def streams(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(piece.stream for piece in self.pieces))

    def of(self, stream: str) -> tuple[Piece, ...]:
        return tuple(piece for piece in self.pieces if piece.stream == stream)


def read_capture(path: Path) -> Capture:
    try:
        text = read_bytes(path, MOST_BYTES).decode()
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "no text"
        raise FileError(str(path), reason, "give a file written by rigd --capture", code="file.invalid") from None
    if not text.startswith(HEAD):
        remedy = f"give a file of rigd --capture: its first line is {HEAD!r}"
        raise FileError(str(path), "is not a capture of rigd", remedy, code="file.invalid")
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
            pieces.append(Piece(int(match[1]), match[2], CaptureMark(match[3]), data))
        except ValueError:
            problem = f"line {number} cannot be read as part of a capture: {line[:40]!r}"
            raise FileError(str(path), problem, "correct or delete that line", code="file.invalid") from None
    return Capture(tuple(pieces), cut)
