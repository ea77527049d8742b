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
from daq.recording.pending_run import Ended
from daq.recording.recorder import Recorder
from daq.recording.trigger import Automat, Command, Start, Stop
from daq.store.manifest import Ending
from rigs.automatic import Automatic, Rule
from rigs.errors import RigError

log = logging.getLogger("rigd")
OPERATOR = "automatic"
_BEFORE_NS = 1_000_000_000
"""Of what came before the event, so much belongs to the run."""
_SHORT_S = 1.0


class Attendant:
    """Starts and ends the runs of one recorder."""

    def __init__(self, recorder: Recorder, automatic: Automatic | None) -> None:
        self._recorder = recorder
        self._rules = automatic.rules if automatic else ()
        self._automat = Automat(self._rules)
        self._deciding = threading.Lock()
        self._heard: deque[Sample] = deque()
        self._mine: str | None = None
        """Name of the run that the automat started and that still goes on."""
        self._starting: deque[tuple[str, str, Future[Path]]] = deque()
        """Title, name and run of each start of which the disk has said nothing yet."""
        self._started_ns = 0
        self._started = 0
        self._refused = 0
        self._why_not = ""

    def hear(self, items: Sequence[Item]) -> None:
        """From the recorder, in the midst of its work: what the robot's stream brought."""
        if self._rules:
            self._heard.extend(samples_of(items))

    def round(self) -> None:
        """After each round of the recorder: the automat hears what came, and is obeyed."""
        if not self._rules:
            return
        with self._deciding:
            self._has_begun()
            self._goes_on()
            while self._heard:
                self._obey(self._automat.hear(self._heard.popleft()))
            self._obey(self._automat.tick(time.monotonic_ns()))

    def start(self, label: Label) -> Path:
        """A person starts a recording; the automat's gives way, where this one can be. Raises CellError."""
        with self._deciding:
            if self._goes_on():
                self._recorder.require_readings(label)
                self._end("interrupted", f"{label.operator or 'a person'} started {label.name}")
                self._automat.forget()
            beginning = self._recorder.start_run(label)
        return beginning.result()

    def stop(self) -> Ended:
        """A person ends a recording, whoever started it, and waits until it is closed. Raises CellError."""
        with self._deciding:
            closing = self._recorder.stop_run()
            self._goes_on()
        return closing.result()

    def state(self) -> dict[str, object] | None:
        """For people: what the automat waits for, whether it records, why it did not; None where it has no rules."""
        if not self._rules:
            return None
        return {
            "waits_for": [rule.event for rule in self._rules],
            "signal": None if math.isnan(self._automat.signal) else self._automat.signal,
            "recording": self._mine,
            "started": self._started,
            "refused": self._refused,
            "why_not": self._why_not,
        }

    def _obey(self, commands: Sequence[Command]) -> None:
        for command in commands:
            if isinstance(command, Start):
                self._begin(command)
            elif self._mine is not None:
                self._end_as(command)

    def _begin(self, start: Start) -> None:
        rule, recording = start.rule, self._recording()
        if recording:
            self._automat.forget()
            self._refuse(rule.title, f"{recording} is being recorded by hand")
            return
        label = Label(name=_name(rule), test=rule.test, direction=rule.direction, operator=OPERATOR)
        try:
            begun = self._recorder.start_run(label, start.at_ns - _BEFORE_NS)
        except RigError as error:
            self._automat.forget()
            self._refuse(rule.title, str(error))
            return
        self._starting.append((rule.title, label.name, begun))
        self._mine, self._started_ns = label.name, start.at_ns

    def _has_begun(self) -> None:
        """What the disk has said of starts."""
        while self._starting and self._starting[0][2].done():
            title, name, begun = self._starting.popleft()
            error = begun.exception()
            if error is None:
                self._started, self._why_not = self._started + 1, ""
                continue
            if name == self._mine:
                self._mine = None
                self._automat.forget()
            self._refuse(title, str(error))

    def _refuse(self, title: str, why: str) -> None:
        self._refused += 1
        self._why_not = f"{title} at {datetime.now():%H:%M:%S}: {why}"
        log.warning("no automatic recording of %s: %s", title, why)

    def _end_as(self, stop: Stop) -> None:
        seconds = (stop.at_ns - self._started_ns) / 1e9
        if seconds < _SHORT_S:
            self._end("interrupted", f"{stop.why}; only {seconds:.2f} s long")
        else:
            self._end("complete" if stop.in_order else "interrupted", stop.why)

    def _end(self, exit_status: Ending, why: str) -> None:
        self._mine = None
        try:
            self._recorder.stop_run(exit_status, why)
        except RigError as error:
            log.error("%s", error)

    def _recording(self) -> object:
        """Name of the recording that goes on, also while it begins or waits for the disk; None for none."""
        state = self._recorder.state()
        return state["recording"] or state["beginning"] or state["waiting"]

    def _goes_on(self) -> bool:
        """Whether the automat's run is still being recorded: a full disk or a person may have ended it."""
        if self._mine is not None and self._recording() != self._mine:
            self._mine = None
            self._automat.forget()
        return self._mine is not None


def _name(rule: Rule) -> str:
    """Unique and in order of time: `20261120T101500.250Z-yaw-cw`."""
    now = datetime.now(UTC)
    return f"{now:%Y%m%dT%H%M%S}.{now.microsecond // 1000:03d}Z-{rule.title.replace(' ', '-')}"
