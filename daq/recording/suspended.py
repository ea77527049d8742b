"""A recording without a run: a disk that was nearly full or failed ended it, and another is to follow when it lets it.

What comes meanwhile is counted, and what the former was given and does not hold.
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
    """From the end of the former run to the begin of the next.

    closing: of the former. taken: samples of each stream that it was given; missed: those that came since.
    at_once: nothing is wrong with the disk; the next begins while the former is being closed.
    """

    label: Label
    previous: Path
    why: str
    closing: Future[Any]
    taken: Counter[str]
    at_once: bool = False
    missed: Counter[str] = field(default_factory=Counter)
    _pause_s: float = field(default_factory=lambda: _FIRST_PAUSE_S)
    _try_at_s: float = field(default_factory=lambda: time.monotonic() + _FIRST_PAUSE_S)

    def is_due(self) -> bool:
        """Whether to try now."""
        return self.at_once or (self.closing.done() and time.monotonic() >= self._try_at_s)

    def postpone(self) -> None:
        """It was tried in vain; pauses double up to a bound."""
        self.at_once = False
        self._try_at_s = time.monotonic() + self._pause_s
        self._pause_s = min(2 * self._pause_s, _LONGEST_PAUSE_S)

    def require_previous_run(self) -> None:
        """Nothing goes below the mount point of a disk that is not there. Raises CellError."""
        if not self.previous.is_dir():
            raise CellError(str(self.previous), "is gone", "bring the disk back that holds it")

    def missed_text(self) -> str:
        """What is missed so far."""
        return ", ".join(f"{count} of {name}" for name, count in self.missed.items() if count) or "none"

    def lost_samples(self) -> Mapping[str, int]:
        """What is in no run: the missed, and of the taken what the former does not hold (all, where it cannot say)."""
        held: Counter[str] = Counter()
        with suppress(FileError):
            for chunk in load_manifest(self.previous).chunks:
                held[chunk.stream] += chunk.rows
        return +self.missed + (self.taken - held)
