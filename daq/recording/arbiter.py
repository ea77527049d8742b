"""Who starts and ends recordings: people, and the trigger of the rig file. People take precedence.

The recorder passes on what came on the robot's stream; after each of its rounds the trigger is fed with it here, and
its commands are carried out. One lock covers a decision and its execution, so that the trigger never ends a recording
that a person started.
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections import deque
from collections.abc import Sequence
from concurrent.futures import Future
from datetime import UTC, datetime
from pathlib import Path

from daq.acquisition.stream_buffer import samples_of
from daq.protocol.conversation import Item, Sample
from daq.recording.label import Label
from daq.recording.pending_run import EndedRun
from daq.recording.recorder import Recorder
from daq.recording.trigger import Command, StartRun, StopRun, Trigger
from daq.store.manifest import Ending
from rigs.errors import RigError
from rigs.schema.recording_rules import Automatic, Rule

log = logging.getLogger("rigd")
OPERATOR = "automatic"
_BEFORE_NS = 1_000_000_000
"""This much of what came before the event belongs to the run."""
_SHORT_S = 1.0


class Arbiter:
    """Starts and ends the runs of one recorder."""

    def __init__(self, recorder: Recorder, automatic: Automatic | None) -> None:
        self._recorder = recorder
        self._rules = automatic.rules if automatic else ()
        self._trigger = Trigger(self._rules)
        self._deciding = threading.Lock()
        self._samples: deque[Sample] = deque()
        self._own_run: str | None = None
        """Name of the run that the trigger started and that is still being recorded."""
        self._starting: deque[tuple[str, str, Future[Path]]] = deque()
        """Title, name and run of each start that the disk has not confirmed yet."""
        self._started_ns = 0
        self._started = 0
        self._refused = 0
        self._why_not = ""

    def feed(self, items: Sequence[Item]) -> None:
        """Keep what came on the robot's stream; the recorder calls this in the middle of its work."""
        if self._rules:
            self._samples.extend(samples_of(items))

    def after_round(self) -> None:
        """Feed the trigger with what came, and execute its commands; the recorder calls this after each round."""
        if not self._rules:
            return
        with self._deciding:
            self._collect_starts()
            self._own_run_continues()
            while self._samples:
                self._execute(self._trigger.feed(self._samples.popleft()))
            self._execute(self._trigger.tick(time.monotonic_ns()))

    def start(self, label: Label) -> Path:
        """Start a recording for a person; one that the trigger started is ended for it. Raises CellError."""
        with self._deciding:
            if self._own_run_continues():
                self._recorder.require_readings(label)
                self._end_run("interrupted", f"{label.operator or 'a person'} started {label.name}")
                self._trigger.reset()
            beginning = self._recorder.start_run(label)
        return beginning.result()

    def stop(self) -> EndedRun:
        """End a recording for a person, whoever started it, and wait until it is closed. Raises CellError."""
        with self._deciding:
            closing = self._recorder.stop_run()
            self._own_run_continues()
        return closing.result()

    def state(self) -> dict[str, object] | None:
        """Return what the trigger waits for, whether it records, and why it did not; None if it has no rules."""
        if not self._rules:
            return None
        return {
            "waits_for": [rule.event for rule in self._rules],
            "signal": None if math.isnan(self._trigger.signal) else self._trigger.signal,
            "recording": self._own_run,
            "started": self._started,
            "refused": self._refused,
            "why_not": self._why_not,
        }

    def _execute(self, commands: Sequence[Command]) -> None:
        for command in commands:
            if isinstance(command, StartRun):
                self._start_run(command)
            elif self._own_run is not None:
                self._stop_run(command)

    def _start_run(self, start: StartRun) -> None:
        rule, current = start.rule, self._current_recording()
        if current:
            self._trigger.reset()
            self._refuse(rule.title, f"{current} is being recorded by hand")
            return
        label = Label(name=_name(rule), test=rule.test, direction=rule.direction, operator=OPERATOR)
        try:
            begun = self._recorder.start_run(label, start.at_ns - _BEFORE_NS)
        except RigError as error:
            self._trigger.reset()
            self._refuse(rule.title, str(error))
            return
        self._starting.append((rule.title, label.name, begun))
        self._own_run, self._started_ns = label.name, start.at_ns

    def _collect_starts(self) -> None:
        """Take note of the starts that the disk has confirmed or refused."""
        while self._starting and self._starting[0][2].done():
            title, name, begun = self._starting.popleft()
            error = begun.exception()
            if error is None:
                self._started, self._why_not = self._started + 1, ""
                continue
            if name == self._own_run:
                self._own_run = None
                self._trigger.reset()
            self._refuse(title, str(error))

    def _refuse(self, title: str, why: str) -> None:
        self._refused += 1
        self._why_not = f"{title} at {datetime.now():%H:%M:%S}: {why}"
        log.warning("no automatic recording of %s: %s", title, why)

    def _stop_run(self, stop: StopRun) -> None:
        seconds = (stop.at_ns - self._started_ns) / 1e9
        if seconds < _SHORT_S:
            self._end_run("interrupted", f"{stop.why}; only {seconds:.2f} s long")
        else:
            self._end_run("complete" if stop.in_order else "interrupted", stop.why)

    def _end_run(self, exit_status: Ending, why: str) -> None:
        self._own_run = None
        try:
            self._recorder.stop_run(exit_status, why)
        except RigError as error:
            log.error("%s", error)

    def _current_recording(self) -> object:
        """Return the name of the present recording, also while it begins or waits for the disk; None without one."""
        state = self._recorder.state()
        return state["recording"] or state["beginning"] or state["waiting"]

    def _own_run_continues(self) -> bool:
        """Return whether the trigger's run is still being recorded; a full disk or a person may have ended it."""
        if self._own_run is not None and self._current_recording() != self._own_run:
            self._own_run = None
            self._trigger.reset()
        return self._own_run is not None


def _name(rule: Rule) -> str:
    """Return a name that is unique and sorts by time: `20261120T101500.250Z-yaw-cw`."""
    now = datetime.now(UTC)
    return f"{now:%Y%m%dT%H%M%S}.{now.microsecond // 1000:03d}Z-{rule.title.replace(' ', '-')}"
