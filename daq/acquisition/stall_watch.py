"""Watching whether rigd itself runs: a thread that only sleeps, and reports when it slept for too long.

A computer that is suspended for a moment, that starves its programs, or a process that is stopped holds up every reader
at once. Readers report their own stalls (`StreamBuffer.beat`); this one says that it was not a single reader.
"""

from __future__ import annotations

from collections import deque

from daq import clock
from daq.acquisition.stream_buffer import STALL_NS
from daq.protocol.conversation import Fault, FaultKind

_SLEEP_S = 0.1


class StallWatch(clock.Thread):
    """Sleeps until `stop`, and keeps a fault for each time it woke up late."""

    def __init__(self) -> None:
        super().__init__(name="stalls", daemon=True)
        self._stop_asked = clock.Event()
        self._faults: deque[Fault] = deque()

    def run(self) -> None:
        """Do the work until `stop`: the body of the thread."""
        before_ns = clock.now_ns()
        while not self._stop_asked.wait(_SLEEP_S):
            now_ns = clock.now_ns()
            self.note(before_ns, now_ns)
            before_ns = now_ns

    def note(self, before_ns: int, now_ns: int) -> None:
        """Keep a fault if the thread was asleep for too long between these times."""
        if now_ns - before_ns > STALL_NS:
            what = f"rigd or the computer stood still for {(now_ns - before_ns) / 1e9:.1f} s"
            self._faults.append(Fault(FaultKind.STALLED, now_ns, f"{what}; what came meanwhile is stamped late"))

    def take(self) -> list[Fault]:
        """Return the faults since the last call."""
        return [self._faults.popleft() for _ in range(len(self._faults))]

    def stop(self) -> None:
        """Ask the thread to end."""
        self._stop_asked.set()
