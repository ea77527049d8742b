"""Who starts and ends recordings: people, and the automat of the rig file. People come first.

The recorder tells what the robot's stream brought; after each of its rounds the automat hears it here, and what it
commands is done. One lock makes a decision and its deed one, so that the automat never ends a person's recording.
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
from rigs.automatic import Automatic, Rule
from rigs.errors import RigError

log = logging.getLogger("rigd")
OPERATOR = "automatic"
_BEFORE_NS = 1_000_000_000
"""Of what came before the event, so much belongs to the run."""
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
        """Name of the run that the automat started and that still goes on."""
        self._starting: deque[tuple[str, str, Future[Path]]] = deque()
        """Title, name and run of each start of which the disk has said nothing yet."""
        self._started_ns = 0
        self._started = 0
        self._refused = 0
        self._why_not = ""

    def feed(self, items: Sequence[Item]) -> None:
        """From the recorder, in the midst of its work: what the robot's stream brought."""
        if self._rules:
            self._samples.extend(samples_of(items))

    def after_round(self) -> None:
        """After each round of the recorder: the automat hears what came, and is obeyed."""
        if not self._rules:
            return
        with self._deciding:
            self._collect_starts()
            self._own_run_continues()
            while self._samples:
                self._execute(self._trigger.feed(self._samples.popleft()))
            self._execute(self._trigger.tick(time.monotonic_ns()))

    def start(self, label: Label) -> Path:
        """A person starts a recording; the automat's gives way, where this one can be. Raises CellError."""
        with self._deciding:
            if self._own_run_continues():
                self._recorder.require_readings(label)
                self._end_run("interrupted", f"{label.operator or 'a person'} started {label.name}")
                self._trigger.reset()
            beginning = self._recorder.start_run(label)
        return beginning.result()

    def stop(self) -> EndedRun:
        """A person ends a recording, whoever started it, and waits until it is closed. Raises CellError."""
        with self._deciding:
            closing = self._recorder.stop_run()
            self._own_run_continues()
        return closing.result()

    def state(self) -> dict[str, object] | None:
        """For people: what the automat waits for, whether it records, why it did not; None where it has no rules."""
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
        """What the disk has said of starts."""
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
        """Name of the recording that goes on, also while it begins or waits for the disk; None for none."""
        state = self._recorder.state()
        return state["recording"] or state["beginning"] or state["waiting"]

    def _own_run_continues(self) -> bool:
        """Whether the automat's run is still being recorded: a full disk or a person may have ended it."""
        if self._own_run is not None and self._current_recording() != self._own_run:
            self._own_run = None
            self._trigger.reset()
        return self._own_run is not None


def _name(rule: Rule) -> str:
    """Unique and in order of time: `20261120T101500.250Z-yaw-cw`."""
    now = datetime.now(UTC)
    return f"{now:%Y%m%dT%H%M%S}.{now.microsecond // 1000:03d}Z-{rule.title.replace(' ', '-')}"
