"""The writer's side: drains every inbox, and while a recording runs, puts what came onto the disk.

One lock guards the recording, and one thread does the periodic work; the readers never take that lock.
A disk that fails ends the recording, not the daemon: what was synced stays, and the state says why.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import Field

from daq.inbox import Inbox, faults_of, samples_of
from daq.protocol.conversation import Item
from daq.recent import Recent
from daq.store import RunWriter
from daq.store.manifest import Ending
from daq.watching import Watch
from rigs.base import Part
from rigs.errors import CellError, RigError
from rigs.vocabulary import Direction, TestName

log = logging.getLogger("rigd")
_SYNC_S = 0.5
_QUIET_S = 10.0
_FRESH_S = 3.0


class Label(Part):
    """What a person says of a recording when it starts."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}$")]
    test: TestName
    direction: Direction | None = None
    operator: str = ""


@dataclass(frozen=True)
class Ended:
    """A recording that was stopped. counters: stream → samples, and faults of each kind."""

    path: Path
    counters: dict[str, dict[str, int]]


class Recorder(threading.Thread):
    """Owns the run that is being recorded, if any."""

    def __init__(
        self,
        inboxes: Mapping[str, Inbox],
        create: Callable[[Label], RunWriter],
        after_round: Callable[[], None],
        listen: Callable[[str, Sequence[Item]], None] = lambda name, items: None,
    ) -> None:
        """listen: hears what every stream brought, while the recorder works; it may only keep it."""
        super().__init__(name="write", daemon=True)
        self._inboxes, self._create, self._after_round = inboxes, create, after_round
        self._listen = listen
        self._recent = Recent(inboxes)
        self._lock = threading.Lock()
        self._stop_asked = threading.Event()
        self._writer: RunWriter | None = None
        self._label: Label | None = None
        self._watch = Watch(touching=False)
        self._since_ns = 0
        self._counters: dict[str, Counter[str]] = {}
        self._told: dict[tuple[str, str], tuple[float, int]] = {}
        self.last_end = ""

    def run(self) -> None:
        """The thread's body: a round every half second, each synced."""
        while not self._stop_asked.wait(_SYNC_S):
            self._round()
        self._round()

    def _round(self) -> None:
        with self._lock:
            self._recent.trim()
            try:
                self._take(sync=True)
            except CellError as error:
                log.error("%s", error)
                self._close("failed", str(error))
        self._after_round()

    def start_run(self, label: Label, since_ns: int | None = None) -> Path:
        """Begin a recording, with the readings since then that are still at hand; returns its directory.

        Raises CellError: one runs already, a gauge is silent, the disk.
        """
        with self._lock:
            if self._writer is not None and self._label is not None:
                raise CellError(f"recording {self._label.name}", "already running", "stop it: rig record stop")
            self._require_readings(label.test)
            self._take(sync=False)
            self._counters = {name: Counter() for name in self._inboxes}
            self._writer, self._label = self._create(label), label
            self._watch = Watch(touching=label.test in ("yaw", "roll"))
            self._since_ns = time.monotonic_ns()
            if since_ns is not None:
                self._since_ns = since_ns
                for name in self._inboxes:
                    self._put(self._writer, name, self._recent.since(name, since_ns))
            log.info("recording %s (%s %s) to %s", label.name, label.test, label.direction, self._writer.path)
            return self._writer.path

    def stop_run(self, exit_status: Ending = "complete", reason: str = "stopped by rig record stop") -> Ended:
        """End the recording. Raises CellError where none runs or its end cannot be written."""
        with self._lock:
            if self._writer is None:
                why = f" (the last one: {self.last_end})" if self.last_end else ""
                raise CellError("rigd", f"nothing is being recorded{why}", "start it: rig record start NAME …")
            path = self._writer.path
            self._take(sync=False)
            if not self._close(exit_status, reason):
                raise CellError(str(path), self.last_end, f"make room, then: rig recover {path}")
            return Ended(path, {name: dict(counter) for name, counter in self._counters.items()})

    def shut_down(self, exit_status: Ending, why: str) -> Path | None:
        """End thread and recording; returns the directory of a recording that was cut short."""
        self._stop_asked.set()
        self.join()
        if self._writer is None:
            return None
        try:
            return self.stop_run(exit_status, why).path
        except RigError as error:
            log.error("%s", error)
            return None

    def state(self) -> dict[str, object]:
        """For people: what is being recorded and since when, or how the last recording ended."""
        label, writer = self._label, self._writer
        if label is None or writer is None:
            return {"recording": None, "last_end": self.last_end}
        return {
            "recording": label.name,
            "test": label.test,
            "direction": label.direction,
            "run": str(writer.path),
            "seconds": round((time.monotonic_ns() - self._since_ns) / 1e9, 1),
            "samples": {name: counter["samples"] for name, counter in self._counters.items()},
        }

    def _take(self, *, sync: bool) -> None:
        """Empty every inbox, into the run where there is one."""
        for name, inbox in self._inboxes.items():
            items = inbox.drain()
            for fault in faults_of(items):
                self._tell(name, fault.kind, fault.detail, fault.count)
            self._listen(name, items)
            self._recent.add(name, items)
            if self._writer is not None:
                self._put(self._writer, name, items)
        if sync and self._writer is not None:
            self._writer.sync()

    def _put(self, writer: RunWriter, name: str, items: Sequence[Item]) -> None:
        samples, faults = samples_of(items), faults_of(items)
        self._counters[name]["samples"] += len(samples)
        for fault in faults:
            if fault.count:
                self._counters[name][fault.kind] += fault.count
        self._inboxes[name].deliver(self._watch.see(name, self._inboxes[name].columns, items))
        writer.append(name, samples)
        writer.append_faults(name, faults)

    def _close(self, exit_status: Ending, reason: str) -> bool:
        """Whether the end could be written."""
        writer, written = self._writer, True
        if writer is None:
            return written
        try:
            writer.close(exit_status, reason, self._counters)
            self.last_end = f"{exit_status}: {reason}"
        except CellError as error:
            self.last_end, written = f"failed: {error}", False
        self._writer = self._label = None
        log.info("recording ended, %s", self.last_end)
        return written

    def _require_readings(self, test: TestName) -> None:
        """Refuse to record a test whose gauge or robot shows nothing: an empty run helps nobody."""
        needed = {"g1_mm", "q1_deg"} | ({"g2_mm"} if test in ("yaw", "roll") else set())
        states = {name: inbox.state() for name, inbox in self._inboxes.items()}
        for column in sorted(needed):
            found = [state for name, state in states.items() if column in self._inboxes[name].columns]
            what = "robot" if column == "q1_deg" else column.removesuffix("_mm")
            if not found:
                raise CellError(what, f"the {test} test needs it, the rig file has none", f"add gauges.{what}")
            if found[0].age_s.get(column, 1e9) > _FRESH_S:
                last = found[0].last_fault or "nothing came at all"
                raise CellError(what, f"no reading in the last {_FRESH_S:.0f} s ({last})", "mend it, then start again")

    def _tell(self, name: str, kind: str, detail: str, count: int) -> None:
        """Log a fault, the same kind again at most every ten seconds, with how many were not told.

        What says more of one that was told (count 0) comes once by itself.
        """
        if not count:
            log.info("%s: %s", name, detail)
            return
        told_at, untold = self._told.get((name, kind), (-1e9, 0))
        now = time.monotonic()
        if now - told_at < _QUIET_S:
            self._told[name, kind] = (told_at, untold + count)
            return
        more = f" ({untold} more since the last such line)" if untold else ""
        log.warning("%s: %s: %s%s", name, kind, detail, more)
        self._told[name, kind] = (now, 0)
