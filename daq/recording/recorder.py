"""The recorder: drains the buffer of every stream and, while a recording runs, writes what came to the disk.

One lock guards the recording, and one thread does the periodic work; the readers never take that lock, and whoever
holds it never waits for the disk to sync: other threads do (`daq.recording.io_worker`), also to begin a run and to
bring one back.
A disk that is nearly full or fails ends the run, but neither the daemon nor the recording: what was synced
stays, what comes meanwhile is counted, and another run that names the previous one follows when the disk allows it.
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

from daq.acquisition.host_clock import HOST, HostClockMonitor, read_clocks
from daq.acquisition.pretrigger import PretriggerBuffer
from daq.acquisition.stall_watch import StallWatch
from daq.acquisition.stream_buffer import StreamBuffer, faults_of, samples_of
from daq.protocol.conversation import Fault, FaultKind, Item
from daq.recording.active_run import ActiveRun
from daq.recording.io_worker import IoWorker
from daq.recording.label import Label
from daq.recording.pending_run import EndedRun, PendingRun, forward_result, require_readings
from daq.recording.rate_limited_log import RateLimitedLog
from daq.recording.suspended import SuspendedRecording
from daq.store import NearlyFull, RunWriter
from daq.store.records import Ending
from daq.store.startup_recovery import recover_and_log
from rigs.errors import CellError, RigError

log = logging.getLogger("rigd")
_ROUND_S = 0.25
_MOST_STOPPED_EARLY = 2
"""The most runs that may be stopped before they exist on the disk: what each of them keeps is in memory."""
_LEAST_PAUSE_S = 0.1
"""The shortest pause: others wait for the lock to start or stop a recording on a slow disk."""


class Recorder(threading.Thread):
    """Owns the run that is being recorded, if any."""

    def __init__(
        self,
        buffers: Mapping[str, StreamBuffer],
        create: Callable[[Label, str], RunWriter],
        after_round: Callable[[], None],
        on_items: Callable[[str, Sequence[Item]], None] = lambda name, items: None,
    ) -> None:
        """create: begins a run of this label that continues the run of that name, or none if the name is empty.

        on_items: is called with what came on every stream, while the recorder works; it may only keep it.
        """
        super().__init__(name="write", daemon=True)
        self._buffers, self._create, self._after_round = buffers, create, after_round
        self._on_items = on_items
        self._pretrigger = PretriggerBuffer(buffers)
        self._lock = threading.Lock()
        self._stop_asked = threading.Event()
        self._active: ActiveRun | None = None
        self._suspended: SuspendedRecording | None = None
        self._pending: PendingRun | None = None
        self._stopped_early: list[PendingRun] = []
        """Runs that were stopped before they existed on the disk."""
        self._warnings = RateLimitedLog()
        self._io = IoWorker(self._warnings)
        self._host_clock, self._stalls = HostClockMonitor(read_clocks()), StallWatch()
        self.host_faults: Counter[str] = Counter()
        """Faults of the computer itself, by kind, since the daemon started."""
        self.last_end = ""

    def run(self) -> None:
        """Do a round every quarter of a second, later only if one takes longer: the body of the thread."""
        self._stalls.start()
        pause_s = _ROUND_S
        while not self._stop_asked.wait(pause_s):
            begun = time.monotonic()
            self._round()
            pause_s = max(_LEAST_PAUSE_S, _ROUND_S - (time.monotonic() - begun))
        self._stalls.stop()
        self._round()

    def _round(self) -> None:
        with self._lock:
            begun = time.monotonic()
            self._pretrigger.trim()
            try:
                self._drain_buffers(sync=True)
            except NearlyFull as error:
                self._suspend("interrupted", error.what)
            except CellError as error:
                self._suspend("failed", str(error))
            self._resume()
            self._warnings.warn_slow("write", time.monotonic() - begun)
        self._after_round()

    def require_readings(self, label: Label) -> None:
        """Raise CellError if a recording of this label could not start because a gauge is silent."""
        require_readings(self._buffers, label.test)

    def start_run(self, label: Label, since_ns: int | None = None) -> Future[Path]:
        """Begin a recording, with the readings since `since_ns` that are still in memory.

        The future has its directory as soon as it exists, and raises CellError if the disk refuses.
        Raises CellError if a recording runs already or a gauge is silent.
        """
        with self._lock:
            runs = self._active or self._pending
            if runs is not None and not (isinstance(runs, PendingRun) and runs.is_after_failure):
                raise CellError(f"recording {runs.label.name}", "already running", "stop it: rig record stop")
            if len(self._stopped_early) >= _MOST_STOPPED_EARLY:
                what = f"is still creating the last {_MOST_STOPPED_EARLY} runs, which were stopped early"
                raise CellError("disk", what, "try again in some seconds; if it stays so, run rig doctor")
            self.require_readings(label)
            self._drain_buffers(sync=False)
            if self._pending is not None:
                self._stop_early(self._pending, "interrupted", f"{label.name} was started")
            self._abandon()
            kept = {name: [] if since_ns is None else self._pretrigger.since(name, since_ns) for name in self._buffers}
            pending = PendingRun(label, None, kept)
            pending.since_ns = since_ns or pending.since_ns
            return self._request_run(pending)

    def stop_run(
        self, exit_status: Ending = "complete", reason: str = "stopped by rig record stop"
    ) -> Future[EndedRun]:
        """End the recording; the future has the run when it is closed, and raises CellError if it cannot be closed.

        Raises CellError if nothing is being recorded.
        """
        with self._lock:
            self._drain_buffers(sync=False)
            if self._pending is not None:
                return self._stop_early(self._pending, exit_status, reason)
            if self._active is None:
                why = f" (the last one: {self.last_end}{self._abandon()})" if self.last_end else ""
                raise CellError("rigd", f"nothing is being recorded{why}", "start it: rig record start NAME …")
            return self._close(self._active, exit_status, reason)

    def shut_down(self, exit_status: Ending, why: str) -> Path | None:
        """End the thread and the recording; return the directory of a recording that was cut short."""
        self._stop_asked.set()
        self.join()
        with self._lock:
            runs = self._active is not None or self._pending is not None
            if not runs:
                self._abandon()
        try:
            return self.stop_run(exit_status, why).result().path if runs else None
        except RigError as error:
            log.error("%s", error)
            return None
        finally:
            self._io.shut_down()

    def state(self) -> dict[str, object]:
        """Return what is being recorded and since when, or how the last recording ended."""
        pending, suspended = self._pending, self._suspended  # first: what has begun since is then seen as recording
        active = self._active
        if active is None:
            return {
                "recording": None,
                "beginning": pending.label.name if pending else None,
                "closing": self._io.is_closing or bool(self._stopped_early),
                "last_end": self.last_end,
                "waiting": suspended.label.name if suspended else None,
                "missed": dict(suspended.missed) if suspended else {},
            }
        return {
            "recording": active.label.name,
            "test": active.label.test,
            "direction": active.label.direction,
            "run": str(active.writer.path),
            "seconds": round((time.monotonic_ns() - active.since_ns) / 1e9, 1),
            "samples": {name: active.counters[name]["samples"] for name in self._buffers},
            "synced": {name: self._io.synced.get(name, 0) for name in self._buffers},
        }

    def _request_run(self, pending: PendingRun) -> Future[Path]:
        self._pending = pending
        self._io.submit_create(partial(self._create_run, pending))
        return pending.begun

    def _create_run(self, pending: PendingRun) -> None:
        """Create the run and begin to use it; called in a thread of the disk's."""
        try:
            lost_samples = self._not_recorded(pending.resumes) if pending.resumes else {}
            writer = self._create(pending.label, pending.follows)
        except Exception as error:  # noqa: BLE001 - whoever waits for the run is told
            with self._lock:
                self._refuse(pending, error)
            return
        with self._lock:
            try:
                self._created(pending, writer, lost_samples)
            except Exception as error:
                self._forget(pending)
                pending.fail(error)
                raise

    def _refuse(self, pending: PendingRun, error: Exception) -> None:
        self._forget(pending)
        pending.reject(error)
        if not isinstance(error, RigError):
            log.error("recording %s: not started because of an internal error", pending.label.name, exc_info=error)
        if pending.stop is not None:
            _abandoned(pending.resumes)
        elif pending.resumes is not None and isinstance(error, RigError):
            self._warnings.warn("recording", "waits", f"{error} (samples missed: {pending.resumes.missed_text()})")

    def _forget(self, pending: PendingRun) -> None:
        if pending.stop is None:
            self._pending = None
        elif pending in self._stopped_early:
            self._stopped_early.remove(pending)

    def _created(self, pending: PendingRun, writer: RunWriter, lost_samples: Mapping[str, int]) -> None:
        label = pending.label
        columns = {name: buffer.columns for name, buffer in self._buffers.items()}
        active = ActiveRun(label, writer, pending.since_ns, columns)
        after = f", after {pending.follows}" if pending.follows else ""
        what = f"{label.test} {label.direction}" if label.direction else label.test
        log.info("recording %s (%s) to %s%s", label.name, what, writer.path, after)
        for name, items in pending.kept.items():
            self._report(name, active.put(name, items))
        active.put_host(pending.host_faults)
        for name, count in lost_samples.items():
            why = f": {pending.resumes.why}" if pending.resumes else ""
            detail = f"{count} samples not recorded after {pending.follows}{why}"
            dropped = [Fault(FaultKind.DROPPED, time.monotonic_ns(), detail, count)]
            active.put(name, dropped)
            self._report(name, dropped)
        if pending.stop is None:
            self._active, self._suspended = active, None
        else:
            forward_result(self._close(active, *pending.stop), pending.ended)
        self._forget(pending)  # only now: `state` sees no moment with neither
        pending.begun.set_result(writer.path)

    def _stop_early(self, pending: PendingRun, exit_status: Ending, reason: str) -> Future[EndedRun]:
        """Let the pending run end as soon as it exists: what comes from now on does not belong to it."""
        self._pending = self._suspended = None
        self._stopped_early.append(pending)
        self.last_end = f"{exit_status}: {reason}"
        return pending.end(exit_status, reason)

    def _drain_buffers(self, *, sync: bool) -> None:
        """Drain every buffer into the run, if there is one; at its end also those of streams that are behind."""
        for name, buffer in self._buffers.items():
            to = self._pending or (self._active.writer if self._active is not None else None)
            if sync and to is not None and to.is_behind(name):
                continue  # a buffer is bounded, and counts what finds no room
            items = buffer.drain()
            self._warn(name, faults_of(items))
            self._on_items(name, items)
            self._pretrigger.add(name, items)
            if self._pending is not None:
                self._pending.keep(name, items)
            elif self._suspended is not None:
                self._suspended.missed[name] += len(samples_of(items))
            if self._active is not None:
                self._report(name, self._active.put(name, items))
        self._check_host()
        if sync and self._active is not None:
            self._active.writer.write()
            self._io.advance(self._active.writer)

    def _suspend(self, exit_status: Ending, why: str) -> None:
        """End the run but not the recording; what was taken and is not stored counts as missed."""
        active = self._active
        if active is None:
            return
        path = active.writer.path
        closing = self._close(active, exit_status, why)
        self._suspended = SuspendedRecording(active.label, path, active.writer.device, why, closing, active.taken)
        log.error("%s: run ended, %s: %s; another run follows when the disk allows it", path, exit_status, why)

    def _resume(self) -> None:
        """Continue a suspended recording in another run, if it is due."""
        if self._suspended is not None and self._pending is None and self._suspended.is_due():
            self._request_run(PendingRun(self._suspended.label, self._suspended, {name: [] for name in self._buffers}))

    def _not_recorded(self, suspended: SuspendedRecording) -> Mapping[str, int]:
        """Return what is in no run, after recovering the previous one. Raises CellError if its disk is away."""
        suspended.require_disk()
        try:
            recover_and_log(suspended.previous)
        except RigError as error:
            self._warnings.warn("recording", "former", str(error))
        return suspended.lost_samples()

    def _abandon(self) -> str:
        """Stop waiting for the disk; return what that means in words, empty if nothing was waiting."""
        suspended, self._suspended = self._suspended, None
        return _abandoned(suspended)

    def _warn(self, name: str, faults: Sequence[Fault]) -> None:
        for fault in faults:
            self._warnings.warn(name, fault.kind, fault.detail, fault.count)

    def _report(self, name: str, faults: Sequence[Fault]) -> None:
        """Log and count faults of a stream that were found here and are in the run already."""
        self._warn(name, faults)
        self._buffers[name].count(faults)

    def _check_host(self) -> None:
        """Report that the wall clock was set, that the computer slept, or that rigd stood still."""
        faults = self._host_clock.check(read_clocks()) + self._stalls.take()
        self._warn(HOST, faults)
        self.host_faults.update(fault.kind for fault in faults)
        if self._pending is not None:
            self._pending.host_faults += faults
        elif self._active is not None:
            self._active.put_host(faults)

    def _close(self, active: ActiveRun, exit_status: Ending, reason: str) -> Future[EndedRun]:
        """Hand the run to the disk's thread, which closes it."""
        self._active = None
        self.last_end = f"{exit_status}: {reason}"
        return self._io.submit_close(partial(self._close_run, active, exit_status, reason))

    def _close_run(self, active: ActiveRun, exit_status: Ending, reason: str) -> EndedRun:
        """Close the run; called in the disk's thread. Raises CellError if the end cannot be written."""
        path, counters = active.writer.path, active.counters
        try:
            active.writer.close(exit_status, reason, counters)
        except CellError as error:
            self.last_end = f"failed: {error}"
            log.error("recording ended, %s", self.last_end)
            raise CellError(str(path), self.last_end, f"make room, then: rig recover {path}") from error
        except Exception:  # nobody may ask what became of the run, as of one that the robot ended
            self.last_end = "failed: not closed because of an internal error"
            log.exception("%s: not closed because of an internal error; run: rig recover %s", path, path)
            raise
        log.info("recording ended, %s", self.last_end)
        return EndedRun(path, {name: dict(counter) for name, counter in counters.items()})


def _abandoned(suspended: SuspendedRecording | None) -> str:
    """Return what it means that a recording is given up, in words; empty if nothing was suspended."""
    if suspended is None:
        return ""
    told = f"; it was waiting for the disk and is given up, samples missed: {suspended.missed_text()}"
    log.warning("recording %s: ended%s", suspended.label.name, told)
    return told
