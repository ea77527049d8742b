"""Start and end of recordings, by operators and by the trigger of the rig file.

A signal starts a recording when it changes to the value of a rule, a motion when the robot leaves a posture in which it
stood. Both end the previous run. A run ends when the robot stands still after the end of the signal, or soon after it
if the robot continues to move. Surplus readings at both ends are harmless, because the evaluation finds the lap.
"""

from __future__ import annotations

import logging
import math
from collections import deque
from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path

from daq import clock
from daq.acquisition.stream_buffer import samples_of
from daq.protocol.conversation import Item, Sample
from daq.recording.active_run import EndedRun, RunLabel
from daq.recording.machine import RecordingRequest
from daq.recording.recorder import Recorder
from daq.store.ledger import Ending
from rigs.errors import RigError
from rigs.schema.declared_tests import NEAR_DEG, STILL_DEG, STOOD_S, Automatic, Rule, When, largest_difference_deg

_S = 1_000_000_000
_SETTLED_NS = _S // 10
"""Time for which a signal must stay: the outputs that form a number do not switch simultaneously."""
_STOOD_NS = round(STOOD_S * _S)
_TAIL_NS = 10 * _S
"""Time from the end of the signal to the end of the run, if the robot continues to move."""
_SILENT_NS = 10 * _S
AXES = 6


@dataclass(frozen=True)
class StartRun:
    rule: Rule
    at_ns: int


@dataclass(frozen=True)
class StopRun:
    """End the run. in_order: the event ended as specified by the rule."""

    at_ns: int
    why: str
    in_order: bool = True


Command = StartRun | StopRun


class Trigger:
    def __init__(self, rules: Sequence[Rule]) -> None:
        self._rules = rules
        self._standstill = _Standstill()
        self._signal = _SettledSignal()
        self._departures = [(rule, _Departure(rule.when)) for rule in rules if rule.when.from_deg]
        self._running: Rule | None = None
        self._over_ns: int | None = None
        """Time at which the event of the running rule ended, or None while the signal is active."""
        self._last_sample_ns = 0

    @property
    def signal(self) -> float:
        """Signal of the robot, nan before the first sample or if it has no signal."""
        return self._signal.value

    def feed(self, sample: Sample) -> list[Command]:
        at_ns = self._last_sample_ns = sample.last_byte_ns
        joints = sample.values[:AXES]
        self._standstill.feed(joints, at_ns)
        changed_ns = self._signal.feed(sample.values[AXES], at_ns) if len(sample.values) > AXES else None
        started = self._started(joints, at_ns, changed_ns)
        if started is None:
            rule = self._running
            if rule is None:
                return []
            # a change to a value with a rule would have started a run
            if changed_ns is not None and self._over_ns is None:
                self._over_ns = changed_ns
            if self._over_ns is None:
                return []
            if at_ns - max(self._over_ns, self._standstill.since_ns) >= rule.still_s * _S:
                return self._stop(StopRun(at_ns, "the robot stands still"))
            if rule.when.signal is not None and at_ns - self._over_ns >= _TAIL_NS:
                return self._stop(StopRun(at_ns, f"the signal ended {_TAIL_NS // _S} s ago"))
            return []
        commands: list[Command] = [StopRun(started.at_ns, "the next began")] if self._running else []
        self._running = started.rule
        self._over_ns = at_ns if started.rule.when.signal is None else None
        return [*commands, started]

    def tick(self, now_ns: int) -> list[Command]:
        """Commands that result from elapsed time, in case the robot has stopped sending."""
        if self._running is None or now_ns - self._last_sample_ns < _SILENT_NS:
            return []
        return self._stop(StopRun(now_ns, f"the robot sent no data for {_SILENT_NS // _S} s", in_order=False))

    def reset(self) -> None:
        self._running = None

    def _started(self, joints: Sequence[float], at_ns: int, changed_ns: int | None) -> StartRun | None:
        departures = [
            (rule, departure.feed(joints, self._standstill.since_ns, at_ns)) for rule, departure in self._departures
        ]
        if changed_ns is not None:
            for rule in self._rules:
                if rule.when.signal == self._signal.value:
                    return StartRun(rule, changed_ns)
        return next((StartRun(rule, left_ns) for rule, left_ns in departures if left_ns is not None), None)

    def _stop(self, stop: StopRun) -> list[Command]:
        self._running = None
        return [stop]


class _Standstill:
    def __init__(self) -> None:
        self.since_ns = 0
        self._at: Sequence[float] = (math.inf,) * AXES

    def feed(self, joints: Sequence[float], at_ns: int) -> None:
        if largest_difference_deg(joints, self._at) > STILL_DEG:
            self._at, self.since_ns = joints, at_ns


class _SettledSignal:
    def __init__(self) -> None:
        self.value = math.nan
        self._next = math.nan
        self._since_ns = 0

    def feed(self, value: float, at_ns: int) -> int | None:
        """Time of a settled change; None if the value is unchanged, or the first one, whose start is unknown."""
        if value == self.value:
            self._next = math.nan
            return None
        if value != self._next:  # nan differs from itself, so it never settles
            self._next, self._since_ns = value, at_ns
        if at_ns - self._since_ns < _SETTLED_NS:
            return None
        first = math.isnan(self.value)
        self.value, self._next = value, math.nan
        return None if first else self._since_ns


class _Departure:
    def __init__(self, when: When) -> None:
        self._from, self._to = when.from_deg or (), when.to_deg or ()
        self._way = math.dist(self._from, self._to)
        self._left_ns: int | None = None

    def feed(self, joints: Sequence[float], stands_since_ns: int, at_ns: int) -> int | None:
        """Time of departure once the robot is halfway to the next posture."""
        if largest_difference_deg(joints, self._from) <= NEAR_DEG:
            if at_ns - stands_since_ns >= _STOOD_NS:
                self._left_ns = at_ns
            return None
        left_ns = self._left_ns
        arrives = math.dist(joints, self._to) < self._way / 2
        if arrives or math.dist(joints, self._from) > 2 * self._way:
            self._left_ns = None
        return left_ns if arrives else None


log = logging.getLogger("rigd")
OPERATOR = "automatic"
_BEFORE_NS = 1_000_000_000
_SHORT_S = 1.0


class Arbiter:
    def __init__(self, recorder: Recorder, automatic: Automatic | None) -> None:
        self._recorder = recorder
        self._rules = automatic.rules if automatic else ()
        self._trigger = Trigger(self._rules)
        self._samples: deque[Sample] = deque()
        self._own_run: str | None = None
        """Name of the current run, if the trigger started it."""
        self._starting: deque[tuple[str, str, Future[Path]]] = deque()
        """Starts not confirmed by the disk: title, name and run."""
        self._started_ns = 0
        self._started = 0
        self._refused = 0
        self._why_not = ""

    def feed(self, items: Sequence[Item]) -> None:
        if self._rules:
            self._samples.extend(samples_of(items))

    def after_round(self) -> None:
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

    def start(self, label: RunLabel) -> Path:
        """Start a recording for an operator, which ends one started by the robot."""
        return clock.result(self._recorder.start_run(RecordingRequest(label)))

    def stop(self) -> EndedRun:
        return clock.result(self._recorder.stop_run())

    def state(self) -> dict[str, object] | None:
        """State of the trigger and the reason for a refused start. None if the rig file has no rules."""
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
        label = RunLabel(
            name=f"{now:%Y%m%dT%H%M%S}.{now.microsecond // 1000:03d}Z-{rule.title.replace(' ', '-')}",
            test=rule.test,
            direction=rule.direction,
            operator=OPERATOR,
        )
        try:
            begun = self._recorder.start_run(RecordingRequest(label, "robot", start.at_ns - _BEFORE_NS))
        except RigError as error:
            self._trigger.reset()
            self._refuse(rule.title, f"a manual recording, {current.label.name}, is running" if current else str(error))
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
        """True if the recording of the robot continues, including the time before the run exists."""
        current = self._recorder.recording
        return current is not None and current.label.name == self._own_run
