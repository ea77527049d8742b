"""The file in which `rig replay` marks each second that was out of step, and which rigd follows while it records.

The rig file of a replayed cell names it (`replay:`). Each line is a second of a stream that was too far from its time;
it becomes a fault of that stream, in the run that is being recorded, and no figures are taken from such a run.
"""

from __future__ import annotations

import re
from pathlib import Path

from daq import clock
from daq.protocol.conversation import Fault, FaultKind
from rigs.errors import FileError
from rigs.files import read_from

_LINE = re.compile(r"(\S+) ([+-][0-9.]+)")
_MOST_BYTES = 1_000_000
"""Bytes that are read at a time, of a file that grows by some 20 bytes a second and stream."""


def out_of_step_line(stream: str, off_ns: float) -> str:
    """Return a line of the file: the median error of this stream's time over one second."""
    return f"{stream} {off_ns / 1e6:+.1f}\n"


class ReplayMarks:
    """Reads what is added to the file, once it has been skipped to its end."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._end = 0
        """Bytes that were read, up to the end of a line."""

    def skip(self) -> None:
        """Leave out what is there already."""
        before = -1
        while before < self._end:
            before = self._end
            self._lines()

    def read_new(self) -> list[tuple[str, Fault]]:
        """Return what was added since the last call: names of streams, and the fault of each."""
        marks = []
        for line in filter(None, map(_LINE.fullmatch, self._lines())):
            detail = f"the replay was {line[2]} ms out of step for a second; replay it on a computer that is less busy"
            marks.append((line[1], Fault(FaultKind.OUT_OF_STEP, clock.now_ns(), detail)))
        return marks

    def _lines(self) -> list[str]:
        """Return the complete lines that follow, as many as one call takes; none if the replay, and its file with it,
        is gone."""
        try:
            data, size = read_from(self._path, self._end, _MOST_BYTES)
        except (OSError, FileError):
            return []
        if size < self._end:  # a replay that starts empties the file
            self._end = 0
            return self._lines()
        complete, newline, incomplete = data.rpartition(b"\n")
        # So many bytes without an end of a line are no line.
        self._end += len(data) if len(incomplete) == _MOST_BYTES else len(complete + newline)
        return complete.decode(errors="replace").split("\n")
