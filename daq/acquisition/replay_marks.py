"""The file in which `rig replay` marks each second that was out of step, and which rigd follows while it records.

The rig file of a replayed cell names it (`replay:`). Each line is a second of a stream that was too far from its time;
it becomes a fault of that stream, in the run that is being recorded, and no figures are taken from such a run.
"""

from __future__ import annotations

import re
import time
from pathlib import Path

from daq.protocol.conversation import Fault, FaultKind

_LINE = re.compile(r"(\S+) ([+-][0-9.]+)")


def out_of_step_line(stream: str, off_ns: float) -> str:
    """Return a line of the file: the median error of this stream's time over one second."""
    return f"{stream} {off_ns / 1e6:+.1f}\n"


class ReplayMarks:
    """Reads what is added to the file, once it has been skipped to its end."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._read = 0

    def skip(self) -> None:
        """Leave out what is there already."""
        self._read = len(self._lines())

    def read_new(self) -> list[tuple[str, Fault]]:
        """Return what was added since the last call: names of streams, and the fault of each."""
        lines = self._lines()[self._read :]
        self._read += len(lines)
        found = []
        for line in filter(None, map(_LINE.fullmatch, lines)):
            detail = f"the replay was {line[2]} ms out of step for a second; replay it on a computer that is less busy"
            found.append((line[1], Fault(FaultKind.OUT_OF_STEP, time.monotonic_ns(), detail)))
        return found

    def _lines(self) -> list[str]:
        """Return the complete lines; none if the replay, and its file with it, is gone."""
        try:
            return self._path.read_text(encoding="utf-8").split("\n")[:-1]
        except OSError:
            return []
