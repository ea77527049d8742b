"""A suspended recording: a disk that was nearly full or failed ended its run, and another run follows when it can.

What comes meanwhile is counted, and so is what was put into the previous run and is not stored in it.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from daq.recording.label import Label
from daq.store.manifest import load_manifest
from rigs.errors import CellError, FileError

_FIRST_PAUSE_S = 5.0
_LONGEST_PAUSE_S = 60.0


@dataclass
class SuspendedRecording:
    """A recording between the end of the previous run and the begin of the next.

    device: of the disk that holds the previous run. closing: of that run. taken: samples of each stream that were put
    into it; missed: those that came since.
    """

    label: Label
    previous: Path
    device: int
    why: str
    closing: Future[Any]
    taken: Counter[str]
    missed: Counter[str] = field(default_factory=Counter)
    _pause_s: float = field(default_factory=lambda: _FIRST_PAUSE_S)
    _try_at_s: float = field(default_factory=lambda: time.monotonic() + _FIRST_PAUSE_S)

    def is_due(self) -> bool:
        """Return whether the next run should be tried now."""
        return self.closing.done() and time.monotonic() >= self._try_at_s

    def postpone(self) -> None:
        """Wait for longer after a failed attempt; the pauses double up to a limit."""
        self._try_at_s = time.monotonic() + self._pause_s
        self._pause_s = min(2 * self._pause_s, _LONGEST_PAUSE_S)

    def require_disk(self) -> None:
        """Raise CellError if the disk is not mounted, so that nothing is written below its mount point.

        It is there if it shows the previous run, or is the same disk without it: somebody deleted or moved that run.
        """
        with suppress(OSError):
            if self.previous.is_dir() or self.previous.parent.stat().st_dev == self.device:
                return
        raise CellError(str(self.previous), "is gone", "mount the disk that holds it again")

    def missed_text(self) -> str:
        """Return how many samples of each stream are missed so far."""
        return ", ".join(f"{count} of {name}" for name, count in self.missed.items() if count) or "none"

    def lost_samples(self) -> Mapping[str, int]:
        """Return the samples that are in no run: those missed, and those taken that the previous run does not hold.

        Where the manifest of that run cannot be read, all that were taken count as lost.
        """
        held: Counter[str] = Counter()
        with suppress(FileError):
            for chunk in load_manifest(self.previous).chunks:
                held[chunk.stream] += chunk.rows
        return +self.missed + (self.taken - held)
