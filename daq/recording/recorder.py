"""The writer's side: drains every inbox, and while a recording runs, puts what came onto the disk.

One lock guards the recording, and one thread does the periodic work; the readers never take that lock, and whoever
holds it never waits for the disk to sync: other threads do (`daq.recording.io_worker`), also to begin a run and to
bring one back.
A disk that is nearly full or fails ends the run, not the daemon and not the recording: what was synced
stays, what comes meanwhile is counted, and a run that names the former goes on when the disk lets it.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from functools import partial
from pathlib import Path

from daq.acquisition.host_clock import HOST, ClockWatch, read_clocks
from daq.acquisition.pretrigger import Recent
from daq.acquisition.stream_buffer import Inbox, faults_of, samples_of
from daq.protocol.conversation import Fault, FaultKind, Item
from daq.recording.active_run import Recording
from daq.recording.io_worker import Disk
from daq.recording.label import Label
from daq.recording.pending_run import Beginning, Ended, pass_on, require_readings
from daq.recording.rate_limited_log import QuietLog
from daq.recording.suspended import Waiting
from daq.store import NearlyFull, RunWriter
from daq.store.manifest import Ending
from daq.store.startup_recovery import revive
from rigs.errors import CellError, RigError

log = logging.getLogger("rigd")
_ROUND_S = 0.25
_MOST_LEAVING = 2
"""Runs stopped before the disk had made them, which it may owe us: what each has kept is in memory."""
_LEAST_PAUSE_S = 0.1
"""For who waits to start or stop a recording on a slow disk."""


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
        self._recording: Recording | None = None
        self._waiting: Waiting | None = None
        self._beginning: Beginning | None = None
        self._leaving: list[Beginning] = []
        """Stopped before the disk had made their runs."""
        self._told = QuietLog()
        self._disk = Disk(self._told)
        self._clocks = ClockWatch(read_clocks())
        self.host_faults: Counter[str] = Counter()
        """Of the computer itself, by kind, since the daemon started."""
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
            if self._recording is not None and self._recording.writer.is_long:
                self._end_for_now("complete", "long enough: another run follows")
            self._try_again()
            self._told.slow("write", time.monotonic() - begun)
        self._after_round()

    def require_readings(self, label: Label) -> None:
        """Raises CellError where a recording of this label could not start, for a gauge that is silent."""
        require_readings(self._inboxes, label.test)

    def start_run(self, label: Label, since_ns: int | None = None) -> Future[Path]:
        """Begin a recording, with the readings since then that are still at hand.

        The future has its directory as soon as the disk does, and raises CellError where it refuses.
        Raises CellError: one runs already, a gauge is silent.
        """
        with self._lock:
            runs = self._recording or self._beginning
            if runs is not None and not (isinstance(runs, Beginning) and runs.is_after_failure):
                raise CellError(f"recording {runs.label.name}", "already running", "stop it: rig record stop")
            if len(self._leaving) >= _MOST_LEAVING:
                raise CellError("the disk", f"has not made the last {_MOST_LEAVING} runs yet", "wait, or mend it")
            self.require_readings(label)
            self._take(sync=False)
            if self._beginning is not None:
                self._leave(self._beginning, "interrupted", f"{label.name} was started")
            self._give_up()
            kept = {name: [] if since_ns is None else self._recent.since(name, since_ns) for name in self._inboxes}
            beginning = Beginning(label, None, kept)
            beginning.since_ns = since_ns or beginning.since_ns
            return self._begin(beginning)

    def stop_run(self, exit_status: Ending = "complete", reason: str = "stopped by rig record stop") -> Future[Ended]:
        """End the recording; closed when the future says so, which raises CellError where it cannot be.

        Raises CellError where none runs.
        """
        with self._lock:
            self._take(sync=False)
            if self._beginning is not None:
                return self._leave(self._beginning, exit_status, reason)
            if self._recording is None:
                why = f" (the last one: {self.last_end}{self._give_up()})" if self.last_end else ""
                raise CellError("rigd", f"nothing is being recorded{why}", "start it: rig record start NAME …")
            return self._close(self._recording, exit_status, reason)

    def shut_down(self, exit_status: Ending, why: str) -> Path | None:
        """End thread and recording; returns the directory of a recording that was cut short."""
        self._stop_asked.set()
        self.join()
        with self._lock:
            runs = self._recording is not None or self._beginning is not None
            if not runs:
                self._give_up()
        try:
            return self.stop_run(exit_status, why).result().path if runs else None
        except RigError as error:
            log.error("%s", error)
            return None
        finally:
            self._disk.rest()

    def state(self) -> dict[str, object]:
        """For people: what is being recorded and since when, or how the last recording ended."""
        beginning, waiting = self._beginning, self._waiting  # first: what has begun since is then seen as recording
        recording = self._recording
        if recording is None:
            waits = waiting if waiting is not None and not waiting.at_once else None
            return {
                "recording": None,
                "beginning": beginning.label.name if beginning else None,
                "closing": self._disk.is_closing or bool(self._leaving),
                "last_end": self.last_end,
                "waiting": waits.label.name if waits else None,
                "missed": dict(waits.missed) if waits else {},
            }
        return {
            "recording": recording.label.name,
            "test": recording.label.test,
            "direction": recording.label.direction,
            "run": str(recording.writer.path),
            "seconds": round((time.monotonic_ns() - recording.since_ns) / 1e9, 1),
            "samples": {name: recording.counters[name]["samples"] for name in self._inboxes},
            "synced": {name: self._disk.synced.get(name, 0) for name in self._inboxes},
        }

    def _begin(self, beginning: Beginning) -> Future[Path]:
        self._beginning = beginning
        self._disk.begin(partial(self._make, beginning))
        return beginning.begun

    def _make(self, beginning: Beginning) -> None:
        """In a thread of the disk's: make the run, and take it into use."""
        try:
            lost = self._lost(beginning.waited) if beginning.waited else {}
            writer = self._create(beginning.label, beginning.follows)
        except Exception as error:  # noqa: BLE001 - whoever waits for the run is told
            with self._lock:
                self._refused(beginning, error)
            return
        with self._lock:
            try:
                self._begun(beginning, writer, lost)
            except Exception as error:
                self._forget(beginning)
                beginning.failed(error)
                raise

    def _refused(self, beginning: Beginning, error: Exception) -> None:
        self._forget(beginning)
        beginning.refused(error)
        if not isinstance(error, RigError):
            log.error("recording %s: not begun, for an error in the program", beginning.label.name, exc_info=error)
        if beginning.stop is not None:
            _given_up(beginning.waited)
        elif beginning.waited is not None and isinstance(error, RigError):
            self._told.tell("recording", "waits", f"{error} (samples missed: {beginning.waited.words()})")

    def _forget(self, beginning: Beginning) -> None:
        if beginning.stop is None:
            self._beginning = None
        elif beginning in self._leaving:
            self._leaving.remove(beginning)

    def _begun(self, beginning: Beginning, writer: RunWriter, lost: Mapping[str, int]) -> None:
        label = beginning.label
        columns = {name: inbox.columns for name, inbox in self._inboxes.items()}
        recording = Recording(label, writer, beginning.since_ns, columns)
        after = f", after {beginning.follows}" if beginning.follows else ""
        what = f"{label.test} {label.direction}" if label.direction else label.test
        log.info("recording %s (%s) to %s%s", label.name, what, writer.path, after)
        told = {name: recording.put(name, items) for name, items in beginning.kept.items()}
        recording.put_clock(beginning.clock)
        for name, count in lost.items():
            why = f": {beginning.waited.why}" if beginning.waited else ""
            detail = f"{count} samples not recorded after {beginning.follows}{why}"
            told[name].append(Fault(FaultKind.DROPPED, time.monotonic_ns(), detail, count))
        if beginning.stop is None:
            self._recording, self._waiting = recording, None
            for name, faults in told.items():
                self._inboxes[name].deliver(faults)
        else:
            for name, faults in told.items():
                self._tell(name, faults)
                self._inboxes[name].count(faults)
                recording.put(name, faults)
            pass_on(self._close(recording, *beginning.stop), beginning.ended)
        self._forget(beginning)  # only now: `state` sees no moment with neither
        beginning.begun.set_result(writer.path)

    def _leave(self, beginning: Beginning, exit_status: Ending, reason: str) -> Future[Ended]:
        """The run that begins is to end as soon as it is there: what comes from now on is not for it."""
        self._beginning = self._waiting = None
        self._leaving.append(beginning)
        self.last_end = f"{exit_status}: {reason}"
        return beginning.end(exit_status, reason)

    def _take(self, *, sync: bool) -> None:
        """Empty every inbox, into the run where there is one; at its end also those whose run is behind."""
        for name, inbox in self._inboxes.items():
            to = self._beginning or (self._recording.writer if self._recording is not None else None)
            if sync and to is not None and to.is_behind(name):
                continue  # an inbox has its bound, and counts what finds no room
            items = inbox.drain()
            self._tell(name, faults_of(items))
            self._listen(name, items)
            self._recent.add(name, items)
            if self._beginning is not None:
                self._beginning.keep(name, items)
            elif self._waiting is not None:
                self._waiting.missed[name] += len(samples_of(items))
            if self._recording is not None:
                inbox.deliver(self._recording.put(name, items))
        self._watch_clocks()
        if sync and self._recording is not None:
            self._recording.writer.write()
            self._disk.go_on(self._recording.writer)

    def _end_for_now(self, exit_status: Ending, why: str) -> None:
        """End the run and not the recording: what was taken and not stored counts as missed."""
        recording = self._recording
        if recording is None:
            return
        path, at_once = recording.writer.path, exit_status == "complete"
        closing = self._close(recording, exit_status, why)
        self._waiting = Waiting(recording.label, path, why, closing, recording.taken, at_once=at_once)
        if not at_once:
            log.error("%s: ended for now, %s: %s; goes on when the disk lets it", path, exit_status, why)

    def _try_again(self) -> None:
        """Go on in another run, where one is waited for and the disk lets us."""
        if self._waiting is not None and self._beginning is None and self._waiting.is_due():
            self._begin(Beginning(self._waiting.label, self._waiting, {name: [] for name in self._inboxes}))

    def _lost(self, waiting: Waiting) -> Mapping[str, int]:
        """What is in no run, once the former is brought back. Raises CellError where that is gone."""
        waiting.require_former()
        if waiting.at_once:
            return {}
        try:
            revive(waiting.former)
        except RigError as error:
            self._told.tell("recording", "former", str(error))
        return waiting.lost()

    def _give_up(self) -> str:
        """Wait no longer for the disk; what that means in words, empty where nothing waited."""
        waiting, self._waiting = self._waiting, None
        return _given_up(waiting)

    def _tell(self, name: str, faults: Sequence[Fault]) -> None:
        for fault in faults:
            self._told.tell(name, fault.kind, fault.detail, fault.count)

    def _watch_clocks(self) -> None:
        """Tell where the wall clock was set or the computer slept, and keep what time it is since."""
        faults = self._clocks.look(read_clocks())
        self._tell(HOST, faults)
        self.host_faults[FaultKind.CLOCK] += len(faults)
        if self._beginning is not None:
            self._beginning.clock += faults
        elif self._recording is not None:
            self._recording.put_clock(faults)

    def _close(self, recording: Recording, exit_status: Ending, reason: str) -> Future[Ended]:
        """Let go of the run; the disk's thread closes it."""
        self._recording = None
        self.last_end = f"{exit_status}: {reason}"
        return self._disk.last(partial(self._end, recording, exit_status, reason))

    def _end(self, recording: Recording, exit_status: Ending, reason: str) -> Ended:
        """In the disk's thread. Raises CellError where the end cannot be written."""
        path, counters = recording.writer.path, recording.counters
        try:
            recording.writer.close(exit_status, reason, counters)
        except CellError as error:
            self.last_end = f"failed: {error}"
            log.error("recording ended, %s", self.last_end)
            raise CellError(str(path), self.last_end, f"make room, then: rig recover {path}") from error
        except Exception:  # nobody may ask what became of the run, as of one that the robot ended
            self.last_end = "failed: not closed, for an error in the program"
            log.exception("%s: not closed, for an error in the program; rig recover %s", path, path)
            raise
        log.info("recording ended, %s", self.last_end)
        return Ended(path, {name: dict(counter) for name, counter in counters.items()})


def _given_up(waiting: Waiting | None) -> str:
    """What it means that nobody waits for the disk any more, in words; empty where nothing waited."""
    if waiting is None:
        return ""
    told = f"; it waited for the disk and waits no longer, samples missed: {waiting.words()}"
    log.warning("recording %s: ended%s", waiting.label.name, told)
    return told
