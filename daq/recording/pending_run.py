"""A run that is being created, which takes seconds on a slow disk; what comes meanwhile belongs to it."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from concurrent.futures import Future
from dataclasses import dataclass, field
from pathlib import Path

from daq.acquisition.stream_buffer import StreamBuffer, samples_of
from daq.protocol.conversation import Fault, Item
from daq.recording.label import Label
from daq.recording.suspended import SuspendedRecording
from daq.store.manifest import Ending
from daq.store.writer import MOST_PENDING
from rigs.errors import CellError
from rigs.schema.vocabulary import TestName

_FRESH_S = 3.0


@dataclass(frozen=True)
class EndedRun:
    """A run that was ended. counters: stream → samples, and faults of each kind."""

    path: Path
    counters: dict[str, dict[str, int]]


@dataclass(eq=False)
class PendingRun:
    """A run from its request until it exists on the disk, or is refused.

    resumes: the suspended recording that it continues. kept: what came since, and before that if it was asked for.
    clock: faults of the computer's clock. begun: its directory, or the error that refused it. stop: it ends at once.
    """

    label: Label
    resumes: SuspendedRecording | None
    kept: dict[str, list[Item]]
    clock: list[Fault] = field(default_factory=list)
    since_ns: int = field(default_factory=time.monotonic_ns)
    begun: Future[Path] = field(default_factory=Future)
    stop: tuple[Ending, str] | None = None
    ended: Future[EndedRun] = field(default_factory=Future)

    @property
    def is_after_failure(self) -> bool:
        """Whether it continues a run that the disk ended, so that another recording may take its place."""
        return self.resumes is not None and not self.resumes.at_once

    @property
    def follows(self) -> str:
        """The name of the run that it continues; empty without one."""
        return self.resumes.previous.name if self.resumes else ""

    def keep(self, stream: str, items: Iterable[Item]) -> None:
        """Keep items of a stream for the run."""
        self.kept[stream].extend(items)

    def is_behind(self, stream: str) -> bool:
        """Return whether so much of a stream is kept that no more of it should be drained."""
        return len(self.kept[stream]) >= MOST_PENDING

    def end(self, exit_status: Ending, reason: str) -> Future[EndedRun]:
        """End the run as soon as it has begun; the future has the ended run."""
        self.stop = (exit_status, reason)
        return self.ended

    def reject(self, error: Exception) -> None:
        """Give up the run; if it was to continue a recording, what was kept counts as missed."""
        if self.resumes is not None:
            for name, items in self.kept.items():
                self.resumes.missed[name] += len(samples_of(items))
            self.resumes.postpone()
        self.fail(error)

    def fail(self, error: Exception) -> None:
        """Pass an error on to those who wait for the run to begin or to end."""
        self.begun.set_exception(error)
        self.ended.set_exception(error)


def forward_result(of: Future[EndedRun], to: Future[EndedRun]) -> None:
    """Give the second future the result or the error of the first one."""

    def through(done: Future[EndedRun]) -> None:
        if error := done.exception():
            to.set_exception(error)
        else:
            to.set_result(done.result())

    of.add_done_callback(through)


def require_readings(buffers: Mapping[str, StreamBuffer], test: TestName) -> None:
    """Raise CellError if a gauge that the test needs, or the robot, is missing or has no fresh reading."""
    needed = {"g1_mm", "q1_deg"} | ({"g2_mm"} if test in ("yaw", "roll") else set())
    for column in sorted(needed):
        found = [buffer.state() for buffer in buffers.values() if column in buffer.columns]
        what = "robot" if column == "q1_deg" else column.removesuffix("_mm")
        if not found:
            raise CellError(what, f"the {test} test needs it, but the rig file has none", f"add gauges.{what}")
        if found[0].age_s.get(column, 1e9) > _FRESH_S:
            last = found[0].last_fault or "nothing was received"
            stale = f"no reading in the last {_FRESH_S:.0f} s ({last})"
            raise CellError(what, stale, "fix the cause, then start the recording again")
