"""Who starts and ends recordings: people, and the trigger of the rig file.

The recorder passes on what came on the robot's stream; after each of its rounds the trigger is fed with it here, and
asks for what it commands as the robot. That people take precedence is a matter of the recorder's states.
"""

from __future__ import annotations

import logging
import math
from collections import deque
from collections.abc import Sequence
from concurrent.futures import Future
from pathlib import Path

from daq import clock
from daq.acquisition.stream_buffer import samples_of
from daq.protocol.conversation import Item, Sample
from daq.recording.active_run import EndedRun
from daq.recording.label import Label
from daq.recording.machine import Recording
from daq.recording.recorder import Recorder
from daq.recording.trigger import Command, StartRun, Trigger
from daq.store.records import Ending
from rigs.errors import RigError
from rigs.schema.recording_rules import Automatic

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
        if self._own_run is not None and not self._is_recorded():
            self._own_run = None
            self._trigger.reset()
        while self._samples:
            self._execute(self._trigger.feed(self._samples.popleft()))
        self._execute(self._trigger.tick(clock.now_ns()))

    def start(self, label: Label) -> Path:
        """Start a recording for a person; one that the robot started is ended for it. Raises CellError."""
        return clock.result(self._recorder.start_run(Recording(label)))

    def stop(self) -> EndedRun:
        """End a recording for a person, no matter who started it, and wait until it is closed. Raises CellError."""
        return clock.result(self._recorder.stop_run())

    def state(self) -> dict[str, object] | None:
        """Return what the trigger waits for, whether it records, and why it did not; None if it has no rules."""
        if not self._rules:
            return None
        return {
            "waits_for": [rule.event for rule in self._rules],
            "signal": None if math.isnan(self._trigger.signal) else self._trigger.signal,
            "recording": self._own_run if self._is_recorded() else None,
            "started": self._started,
            "refused": self._refused,
            "why_not": self._why_not,
        }

    def _execute(self, commands: Sequence[Command]) -> None:
        for command in commands:
            if isinstance(command, StartRun):
                self._start_run(command)
            elif self._own_run is not None:
                seconds = (command.at_ns - self._started_ns) / 1e9
                if seconds < _SHORT_S:
                    self._end_run("interrupted", f"{command.why}; only {seconds:.2f} s long")
                else:
                    self._end_run("complete" if command.in_order else "interrupted", command.why)

    def _start_run(self, start: StartRun) -> None:
        rule, current = start.rule, self._recorder.recording
        now = clock.wall_time()
        label = Label(
            name=f"{now:%Y%m%dT%H%M%S}.{now.microsecond // 1000:03d}Z-{rule.title.replace(' ', '-')}",
            test=rule.test,
            direction=rule.direction,
            operator=OPERATOR,
        )
        try:
            begun = self._recorder.start_run(Recording(label, "robot", start.at_ns - _BEFORE_NS))
        except RigError as error:
            self._trigger.reset()
            self._refuse(rule.title, f"{current.label.name} is being recorded by hand" if current else str(error))
            return
        self._starting.append((rule.title, label.name, begun))
        self._own_run, self._started_ns = label.name, start.at_ns

    def _refuse(self, title: str, why: str) -> None:
        self._refused += 1
        self._why_not = f"{title} at {clock.wall_time().astimezone():%H:%M:%S}: {why}"
        log.warning("no automatic recording of %s: %s", title, why)

    def _end_run(self, ending: Ending, why: str) -> None:
        self._own_run = None
        try:
            self._recorder.stop_run(ending, why, "robot")
        except RigError as error:
            log.error("%s", error)

    def _is_recorded(self) -> bool:
        """Return whether the robot's recording goes on, also while its run begins or it waits for the disk."""
        current = self._recorder.recording
        return current is not None and current.label.name == self._own_run
