"""The writer's side: drains every inbox, and while a recording runs, puts what came onto the disk.

One lock guards the recording, and one thread does the periodic work, another waits for the disk to sync; the
readers never take that lock.
A disk that is nearly full or fails ends the run, not the daemon and not the recording: what was synced
stays, what comes meanwhile is counted, and a run that names the former goes on when the disk lets it.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from pydantic import Field

from daq.clockwatch import HOST, ClockWatch, read_clocks
from daq.inbox import Inbox, faults_of, samples_of
from daq.protocol.conversation import Fault, FaultKind, Item
from daq.recent import Recent
from daq.revival import revive
from daq.store import NearlyFull, RunWriter
from daq.store.manifest import Ending, load_manifest
from daq.store.writer import Syncing
from daq.watching import Watch
from rigs.base import Part
from rigs.errors import CellError, FileError, RigError
from rigs.vocabulary import Direction, TestName

log = logging.getLogger("rigd")
_ROUND_S = 0.25
_SYNC_S = 0.5
_LEAST_PAUSE_S = 0.1
"""For who waits to start or stop a recording on a slow disk."""
_QUIET_S = 10.0
_FRESH_S = 3.0
_SLOW_S = 2.0
_FIRST_PAUSE_S = 5.0
_LONGEST_PAUSE_S = 60.0


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


@dataclass
class _Waiting:
    """A recording without a run, from the end of the former to the next.

    taken: samples of each stream that were handed to the former; missed: those that came since.
    """

    label: Label
    former: Path
    why: str
    taken: Counter[str]
    try_at_s: float
    pause_s: float
    missed: Counter[str] = field(default_factory=Counter)

    def words(self) -> str:
        """What is missed so far."""
        return ", ".join(f"{count} of {name}" for name, count in self.missed.items() if count) or "none"

    def lost(self) -> Counter[str]:
        """What is in no run: the missed, and of the taken what the former does not hold (all, where it cannot say)."""
        held: Counter[str] = Counter()
        with suppress(FileError):
            for chunk in load_manifest(self.former).chunks:
                held[chunk.stream] += chunk.rows
        return +self.missed + (self.taken - held)


class Recorder(threading.Thread):
    """Owns the run that is being recorded, if any."""

    def __init__(
        self,
        inboxes: Mapping[str, Inbox],
        create: Callable[[Label, str], RunWriter],
        after_round: Callable[[], None],
        listen: Callable[[str, Sequence[Item]], None] = lambda name, items: None,
    ) -> None:
        """create: begins a run of this label that follows the run of that name, none for an empty one.

        listen: hears what every stream brought, while the recorder works; it may only keep it.
        """
        super().__init__(name="write", daemon=True)
        self._inboxes, self._create, self._after_round = inboxes, create, after_round
        self._listen = listen
        self._recent = Recent(inboxes)
        self._lock = threading.Lock()
        self._stop_asked = threading.Event()
        self._writer: RunWriter | None = None
        self._label: Label | None = None
        self._waiting: _Waiting | None = None
        self._watch = Watch(touching=False)
        self._since_ns = 0
        self._counters: dict[str, Counter[str]] = {}
        self._told: dict[tuple[str, str], tuple[float, int]] = {}
        self._synced: dict[str, int] = {}
        self._disk = ThreadPoolExecutor(1, "sync")
        self._syncing: tuple[Syncing, Future[None]] | None = None
        self._sync_begun_s = 0.0
        self._clocks = ClockWatch(read_clocks())
        self.last_end = ""

    def run(self) -> None:
        """The thread's body: a round every quarter of a second; later only where one takes longer."""
        pause_s = _ROUND_S
        while not self._stop_asked.wait(pause_s):
            begun = time.monotonic()
            self._round()
            pause_s = max(_LEAST_PAUSE_S, _ROUND_S - (time.monotonic() - begun))
        self._round()

    def _round(self) -> None:
        with self._lock:
            begun = time.monotonic()
            self._recent.trim()
            try:
                self._take(sync=True)
            except NearlyFull as error:
                self._end_for_now("interrupted", error.what)
            except CellError as error:
                self._end_for_now("failed", str(error))
            if self._writer is not None and self._writer.is_long:
                self._end_for_now("complete", "long enough: another run follows")
            self._try_again()
            self._tell_slow("write", time.monotonic() - begun)
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
            self._give_up()
            path = self._begin(label, "")
            if since_ns is not None and self._writer is not None:
                self._since_ns = since_ns
                for name in self._inboxes:
                    self._put(self._writer, name, self._recent.since(name, since_ns))
            return path

    def stop_run(self, exit_status: Ending = "complete", reason: str = "stopped by rig record stop") -> Ended:
        """End the recording. Raises CellError where none runs or its end cannot be written."""
        with self._lock:
            if self._writer is None:
                why = f" (the last one: {self.last_end}{self._give_up()})" if self.last_end else ""
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
        self._give_up()
        if self._writer is None:
            return None
        try:
            return self.stop_run(exit_status, why).path
        except RigError as error:
            log.error("%s", error)
            return None

    def state(self) -> dict[str, object]:
        """For people: what is being recorded and since when, or how the last recording ended."""
        label, writer, waiting = self._label, self._writer, self._waiting
        if label is None or writer is None:
            missed = {"waiting": waiting.label.name, "missed": dict(waiting.missed)} if waiting else {"waiting": None}
            return {"recording": None, "last_end": self.last_end, **missed}
        return {
            "recording": label.name,
            "test": label.test,
            "direction": label.direction,
            "run": str(writer.path),
            "seconds": round((time.monotonic_ns() - self._since_ns) / 1e9, 1),
            "samples": {name: self._counters[name]["samples"] for name in self._inboxes},
            "synced": self._synced,
        }

    def _begin(self, label: Label, follows: str) -> Path:
        writer = self._create(label, follows)
        self._counters = {name: Counter() for name in self._inboxes}
        self._watch = Watch(touching=label.test in ("yaw", "roll"))
        self._synced, self._syncing = dict.fromkeys(self._inboxes, 0), None
        self._writer, self._label, self._waiting = writer, label, None
        self._since_ns = time.monotonic_ns()
        after = f", after {follows}" if follows else ""
        log.info("recording %s (%s %s) to %s%s", label.name, label.test, label.direction, writer.path, after)
        return writer.path

    def _take(self, *, sync: bool) -> None:
        """Empty every inbox, into the run where there is one."""
        for name, inbox in self._inboxes.items():
            items = inbox.drain()
            for fault in faults_of(items):
                self._tell(name, fault.kind, fault.detail, fault.count)
            self._listen(name, items)
            self._recent.add(name, items)
            if self._waiting is not None:
                self._waiting.missed[name] += len(samples_of(items))
            if self._writer is not None:
                self._put(self._writer, name, items)
        self._watch_clocks()
        if sync and self._writer is not None:
            self._writer.write()
            self._sync(self._writer)
            self._writer.roll()

    def _sync(self, writer: RunWriter) -> None:
        """Note what has been synced and begin the next, twice a second; another thread waits for the disk.

        So what comes while a slow disk syncs is with the system already, where a kill does not reach it.
        """
        if self._syncing is not None:
            syncing, waiting = self._syncing
            self._tell_slow("sync", time.monotonic() - self._sync_begun_s)
            if not waiting.done():
                return
            self._syncing = None
            writer.end_sync(syncing, waiting.exception())
            self._synced = syncing.rows
        if time.monotonic() - self._sync_begun_s >= _SYNC_S:
            self._sync_begun_s = time.monotonic()
            syncing = writer.begin_sync()
            self._syncing = syncing, self._disk.submit(syncing.wait)

    def _tell_slow(self, what: str, seconds: float) -> None:
        if seconds > _SLOW_S:
            self._tell("disk", f"slow {what}", f"has taken {seconds:.1f} s; readers do not wait for it", 1)

    def _end_for_now(self, exit_status: Ending, why: str) -> None:
        """End the run and not the recording: what was taken and not stored counts as missed."""
        label, writer = self._label, self._writer
        if label is None or writer is None:
            return
        self._close(exit_status, why)
        pause_s = 0.0 if exit_status == "complete" else _FIRST_PAUSE_S
        if pause_s:
            log.error("%s: ended for now, %s; goes on when the disk lets it", writer.path, self.last_end)
        taken = Counter({name: counter["samples"] for name, counter in self._counters.items()})
        self._waiting = _Waiting(label, writer.path, why, taken, time.monotonic() + pause_s, _FIRST_PAUSE_S)

    def _try_again(self) -> None:
        """Go on in another run, where one is waited for and the disk lets us; pauses double up to a bound."""
        waiting = self._waiting
        if waiting is None or time.monotonic() < waiting.try_at_s:
            return
        try:
            if not waiting.former.is_dir():  # nothing goes below the mount point of a disk that is not there
                raise CellError(str(waiting.former), "is gone", "bring the disk back that holds it")
            self._mend(waiting.former)
            lost = waiting.lost()
            self._begin(waiting.label, waiting.former.name)
        except RigError as error:
            self._tell("recording", "waits", f"{error} (samples missed: {waiting.words()})", 1)
            waiting.try_at_s = time.monotonic() + waiting.pause_s
            waiting.pause_s = min(2 * waiting.pause_s, _LONGEST_PAUSE_S)
            return
        for name, count in lost.items():
            detail = f"{count} samples not recorded after {waiting.former.name}: {waiting.why}"
            self._inboxes[name].deliver([Fault(FaultKind.DROPPED, time.monotonic_ns(), detail, count)])

    def _mend(self, former: Path) -> None:
        try:
            revive(former)
        except RigError as error:
            self._tell("recording", "former", str(error), 1)

    def _give_up(self) -> str:
        """Wait no longer for the disk; what that means in words, empty where nothing waited."""
        waiting, self._waiting = self._waiting, None
        if waiting is None:
            return ""
        told = f"; it waited for the disk and waits no longer, samples missed: {waiting.words()}"
        log.warning("recording %s: ended%s", waiting.label.name, told)
        return told

    def _put(self, writer: RunWriter, name: str, items: Sequence[Item]) -> None:
        samples, faults = samples_of(items), faults_of(items)
        self._counters[name]["samples"] += len(samples)
        for fault in faults:
            if fault.count:
                self._counters[name][fault.kind] += fault.count
        self._inboxes[name].deliver(self._watch.see(name, self._inboxes[name].columns, items))
        writer.append(name, samples)
        writer.append_faults(name, faults)

    def _watch_clocks(self) -> None:
        """Tell where the wall clock was set or the computer slept, and keep what time it is since."""
        faults = self._clocks.look(read_clocks())
        for fault in faults:
            self._tell(HOST, fault.kind, fault.detail, fault.count)
        if faults and self._writer is not None:
            self._counters.setdefault(HOST, Counter())[FaultKind.CLOCK] += len(faults)
            self._writer.append_faults(HOST, faults)
            self._writer.anchor()

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
        self._writer = self._label = self._syncing = None
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
