"""The recorder: drains the buffers of all streams and writes the samples of the current run.

`daq.recording.machine` decides; the recorder executes. One lock guards the state and the runs, and one thread does the
periodic work. Readers never take this lock, and no code waits for the disk while it is taken: the threads of
`daq.recording.io_worker` do.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from functools import partial
from pathlib import Path
from typing import Literal

from daq import clock
from daq.acquisition.stream_buffer import PretriggerBuffer, StreamBuffer, faults_of
from daq.protocol.conversation import Item
from daq.recording import machine
from daq.recording.active_run import ActiveRun, EndedRun, RecordingGap, RunLabel, require_readings, samples_in
from daq.recording.io_worker import IoWorker
from daq.recording.machine import (
    Close,
    Create,
    GiveUp,
    RecorderState,
    RecordingRequest,
    Reject,
    Running,
    Suspend,
    Waiting,
)
from daq.recording.warnings import HostWatch, Losses, RateLimitedLog
from daq.store import NearlyFull, RunWriter
from daq.store.ledger import Ending
from daq.store.run_directory import RunRemoved
from rigs.errors import CellError, RigError
from rigs.text import as_argument


def rejection(rejected: Reject, state: RecorderState, last_end: str) -> CellError:
    if rejected.why == "running" and state.recording:
        where, remedy = f"recording {state.recording.label.name}", "stop the recording: rig record stop"
        return CellError(where, "already running", remedy, code="recording.running")
    if rejected.why == "making":
        problem = f"is still creating the last {machine.MOST_LEAVING} runs, which were stopped early"
        remedy = "retry in some seconds; if the problem persists, run rig doctor"
        return CellError("disk", problem, remedy, code="daemon.busy")
    problem = "no recording is active" + (f" (the last one: {last_end})" if last_end else "")
    return CellError("rigd", problem, "start a recording: rig record start NAME …", code="recording.none")


log = logging.getLogger("rigd")
_ROUND_S = 0.25
_LEAST_PAUSE_S = 0.1
"""Other threads need the lock to start or stop a recording on a slow disk."""


class Recorder(clock.StoppableThread):
    def __init__(
        self,
        buffers: Mapping[str, StreamBuffer],
        create: Callable[[RunLabel, str], RunWriter],
        after_round: Callable[[], None],
        on_items: Callable[[str, Sequence[Item]], None] = lambda name, items: None,
    ) -> None:
        """create: creates a run for a label, to continue the named run if any.

        on_items: receives the new items of every stream and must return quickly.
        """
        super().__init__("write")
        self._buffers, self._create, self._after_round = buffers, create, after_round
        self._on_items = on_items
        self._pretrigger = PretriggerBuffer(buffers)
        self._lock = threading.Lock()
        self._state = RecorderState()
        self._runs: dict[int, ActiveRun] = {}
        self._gap: RecordingGap | None = None
        """Samples missed while a recording waits for the disk."""
        self._warnings = RateLimitedLog()
        self._io = IoWorker(self._warnings)
        self.host, self.losses = HostWatch(self._warnings), Losses(buffers, self._warnings)
        self.last_end = ""
        self._last_path: Path | None = None

    def run(self) -> None:
        self.host.start()
        pause_s = _ROUND_S
        while not self._stop_asked.wait(pause_s):
            begun = clock.now_s()
            self._round()
            pause_s = max(_LEAST_PAUSE_S, _ROUND_S - (clock.now_s() - begun))
        self.host.stop()
        self._round()

    def _round(self) -> None:
        with self._lock:
            begun = clock.now_s()
            self._pretrigger.trim()
            try:
                self._drain_buffers(sync=True)
            except NearlyFull as error:
                self._apply(machine.DiskFailed("interrupted", error.what, clock.now_s()))
            except CellError as error:
                self._apply(machine.DiskFailed("failed", str(error), clock.now_s(), isinstance(error, RunRemoved)))
            for number in [number for number, run in self._runs.items() if run.ended.done()]:
                del self._runs[number]
                self._apply(machine.Closed(number))
            self._apply(machine.Tick(clock.now_s()))
            self._warnings.warn_slow("write", clock.now_s() - begun)
        self._after_round()

    def start_run(self, recording: RecordingRequest) -> Future[Path]:
        """Start a recording. The future contains the directory, or the error of the disk.

        Raises CellError if a recording cannot start now or a gauge is silent.
        """
        with self._lock:
            for action in machine.step(self._state, machine.StartRequested(recording))[1]:
                if isinstance(action, Reject):
                    raise rejection(action, self._state, self.last_end)
            require_readings(self._buffers, recording.label.test)
            self._drain_buffers(sync=False)
            self._apply(machine.StartRequested(recording))
            return self._runs[self._state.next - 1].begun

    def stop_run(
        self,
        ending: Ending = "complete",
        why: str = "stopped by rig record stop",
        by: Literal["person", "robot"] = "person",
    ) -> Future[EndedRun]:
        """End the recording. The future contains the closed run, or the error of the disk. Raises CellError if idle."""
        with self._lock:
            self._drain_buffers(sync=False)
            number = self._state.run or 0
            self._apply(machine.StopRequested(ending, why, by))
            return self._runs[number].ended

    def shut_down(self, ending: Ending, why: str) -> Path | None:
        self.stop()
        self.join()
        in_a_run = self._state.run is not None
        try:
            return clock.result(self.stop_run(ending, why)).path
        except RigError as error:
            if in_a_run:
                log.error("%s", error)
            return None
        finally:
            self._io.shut_down()

    def note_end(self, run: str, reason: str) -> None:
        """Append a later finding about the last run to the reason displayed in the status."""
        with self._lock:
            if run == str(self._last_path):
                self.last_end += f"; cannot be analysed: {reason}"

    @property
    def recording(self) -> RecordingRequest | None:
        return self._state.recording

    def state(self) -> dict[str, object]:
        state, run = self._state, self._current
        if run is None or run.writer is None or not isinstance(state.phase, Running):
            gap = run.gap if run else self._gap
            return {
                "recording": None,
                "beginning": run.label.name if run else None,
                "closing": any(other is not run and not other.ended.done() for other in list(self._runs.values())),
                "last_end": self.last_end,
                "waiting": state.recording.label.name if gap and state.recording else None,
                "missed": dict(gap.missed) if gap else {},
            }
        return {
            "recording": run.label.name,
            "test": run.label.test,
            "direction": run.label.direction,
            "run": str(run.writer.path),
            "seconds": round((clock.now_ns() - run.since_ns) / 1e9, 1),
            "samples": {name: run.counters[name]["samples"] for name in self._buffers},
            "synced": {name: self._io.synced.get(name, 0) for name in self._buffers},
        }

    @property
    def _current(self) -> ActiveRun | None:
        return self._runs.get(self._state.run or 0)

    def _apply(self, event: machine.Event) -> None:
        self._state, actions = machine.step(self._state, event)
        for action in actions:
            match action:
                case Create(number, recording, resumes):
                    columns = {name: buffer.columns for name, buffer in self._buffers.items()}
                    kept, since_ns = {}, None if resumes else recording.since_ns
                    if since_ns is not None:
                        kept = {name: self._pretrigger.since(name, since_ns) for name in self._buffers}
                    run = self._runs[number] = ActiveRun(recording.label, columns, kept, since_ns or clock.now_ns())
                    if resumes:
                        run.gap, self._gap = self._gap, None
                    self._io.submit_create(partial(self._create_run, number, run))
                case Close(number, ending, why):
                    self.last_end = f"{ending}: {why}"
                    self._io.submit_close(partial(self._close_run, self._runs[number], ending, why))
                case Suspend(number, why) if (writer := self._runs[number].writer) is not None:
                    # From now on samples count as missed. Unsaved samples are added when the run is closed.
                    self._gap = RecordingGap(writer.path, writer.device, why, self._runs[number].sample_counts)
                    message = "%s: run ended, %s; a new run follows when the disk allows it"
                    log.error(message, writer.path, self.last_end)
                case GiveUp():
                    self._give_up(self._gap)
                    self._gap = None
                case Reject():
                    raise rejection(action, self._state, self.last_end)

    def _create_run(self, number: int, run: ActiveRun) -> None:
        try:
            dropped = run.gap.not_recorded(self._warnings) if run.gap else {}
            writer = self._create(run.label, run.gap.previous.name if run.gap else "")
        except Exception as error:  # noqa: BLE001 - whoever waits for the run is told
            with self._lock:
                self._refused(number, run, error)
            return
        with self._lock:
            try:
                label = run.label
                after = f", after {run.gap.previous.name}" if run.gap else ""
                kind = f"{label.test} {label.direction}" if label.direction else label.test
                log.info("recording %s (%s) to %s%s", label.name, kind, writer.path, after)
                for name, faults in run.begin(writer, dropped).items():
                    self.losses.report(name, faults)
                self._apply(machine.Created(number))  # first, so that `state` always finds the run
                run.begun.set_result(writer.path)
            except Exception as error:
                self._refused(number, run, error)
                raise

    def _refused(self, number: int, run: ActiveRun, error: Exception) -> None:
        run.refuse(error)
        self._apply(machine.RunRefused(number, clock.now_s()))
        if not isinstance(error, RigError):
            log.error("recording %s: not started because of an internal error", run.label.name, exc_info=error)
        if run.gap and isinstance(self._state.phase, Waiting):
            self._gap = run.gap
            self._warnings.warn("recording", "waits", f"{error} (samples missed: {run.gap.missed_text()})")
        elif run.gap:
            self._give_up(run.gap)
        else:
            self.losses.add(run.buffered_samples, f"{run.label.name} did not begin")

    def _drain_buffers(self, *, sync: bool) -> None:
        """Drain every buffer into the current run. With sync, streams that are behind are skipped."""
        run = self._current
        for name, buffer in self._buffers.items():
            if sync and run is not None and run.is_behind(name):
                continue  # the buffer is bounded and counts the overflow
            items = buffer.drain()
            self._warnings.warn_faults(name, faults_of(items))
            self._on_items(name, items)
            self._pretrigger.add(name, items)
            if run is not None:
                self.losses.report(name, run.put(name, items))
            elif self._gap is not None:
                self._gap.missed[name] += samples_in(items)
        host_faults = self.host.check()
        if run is not None:
            run.put_host(host_faults)
        if sync and run is not None and run.writer is not None:
            run.writer.write()
            self._io.advance(run.writer)

    def _give_up(self, gap: RecordingGap | None) -> None:
        if gap:
            message = f"the recording was waiting for the disk and was abandoned, samples missed: {gap.missed_text()}"
            log.warning("%s: %s", gap.previous, message)
            self.last_end += f"; {message}"
            self.losses.add(gap.missed + gap.lost, f"nothing followed {gap.previous.name}")

    def _settle(self, run: ActiveRun) -> None:
        """Count the losses of a closed run, unless the next run will count them."""
        if run.writer is None or not run.writer.lost.total():
            return
        with self._lock:
            if self._gap and self._gap.previous == run.writer.path:
                self._gap.lost.update(run.writer.lost)
            else:
                self.losses.add(run.writer.lost, f"{run.writer.path.name} could not be closed")

    def _close_run(self, run: ActiveRun, ending: Ending, why: str) -> None:
        path = clock.result(run.begun)
        try:
            try:
                run.close(ending, why)
            finally:
                self._settle(run)
        except CellError as error:
            self.last_end = f"failed: {error}"
            log.error("recording ended, %s", self.last_end)
            remedy = f"fix the cause, then: rig recover {as_argument(path)}"
            repair = CellError(str(path), self.last_end, remedy, code="recording.failed")
            run.ended.set_exception(error if isinstance(error, RunRemoved) else repair)
        except Exception as error:
            self.last_end = "failed: not closed because of an internal error"
            log.exception("%s: not closed because of an internal error; run: rig recover %s", path, path)
            run.ended.set_exception(error)
        else:
            self._last_path = path
            seal = run.writer.seal if run.writer else ""
            log.info("recording ended, %s: %s; sealed as %s", ending, why, seal)
            counters = {name: dict(counter) for name, counter in run.counters.items()}
            run.ended.set_result(EndedRun(path, counters, seal))
