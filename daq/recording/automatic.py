"""Who starts and ends recordings: people, and the trigger of the rig file.

The recorder passes on what came on the robot's stream; after each of its rounds the trigger is fed with it here, and
asks for what it commands as the robot. That people take precedence is a matter of the recorder's states.

The trigger makes commands of what the robot does: samples in, commands out. It owns no clock, recorder or thread, so an
hour of a cell is tested in milliseconds. It knows the rules of a rig file, the robot's six angles and its signal, and
nothing of arms.

A signal starts a recording by changing to a rule's value: one that is on when it is first received began at an
unknown time. It must stay for 0.1 s, since outputs that together make a number do not switch together. A motion
starts one by leaving a posture in which the robot stood, towards another. Either ends the run before it: a run for each
program that is driven.
A run ends when the robot stands still once the signal is over; where it drives on, soon after. The readings that lie
too early or too late in a run do no harm (the lap is found in it), those that are missing do.
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
from daq.recording.active_run import EndedRun, Label
from daq.recording.machine import Recording
from daq.recording.recorder import Recorder
from daq.store.ledger import Ending
from rigs.errors import RigError
from rigs.schema.declared_tests import NEAR_DEG, STILL_DEG, STOOD_S, Automatic, Rule, When

_S = 1_000_000_000
_SETTLED_NS = _S // 10
_STOOD_NS = round(STOOD_S * _S)
_TAIL_NS = 10 * _S
"""A robot that drives on when its signal is over: the run ends without its standing still."""
_SILENT_NS = 10 * _S
AXES = 6


@dataclass(frozen=True)
class StartRun:
    """The command to begin a run for this rule, whose event was at `at_ns`."""

    rule: Rule
    at_ns: int


@dataclass(frozen=True)
class StopRun:
    """The command to end the run that was started; `in_order`: it ended as the rule expects."""

    at_ns: int
    why: str
    in_order: bool = True


Command = StartRun | StopRun


class Trigger:
    """Applies the rules to the samples of the robot, and remembers what it needs between them."""

    def __init__(self, rules: Sequence[Rule]) -> None:
        self._rules = rules
        self._standstill = _Standstill()
        self._signal = _SettledSignal()
        self._departures = [(rule, _Departure(rule.when)) for rule in rules if rule.when.from_deg]
        self._running: Rule | None = None
        self._over_ns: int | None = None
        """When the running rule's event ended; None while its signal is on."""
        self._last_sample_ns = 0

    @property
    def signal(self) -> float:
        """The robot's signal as it is now; nan if it has none or nothing was received yet."""
        return self._signal.value

    def feed(self, sample: Sample) -> list[Command]:
        """Return the commands that a sample causes: the robot's angles in degrees, then its signal if it has one."""
        at_ns = self._last_sample_ns = sample.last_byte_ns
        joints = sample.values[:AXES]
        self._standstill.feed(joints, at_ns)
        changed_ns = self._signal.feed(sample.values[AXES], at_ns) if len(sample.values) > AXES else None
        started = self._started(joints, at_ns, changed_ns)
        if started is None:
            rule = self._running
            if rule is None:
                return []
            if changed_ns is not None and self._over_ns is None:  # to another value, or it would have started a run
                self._over_ns = changed_ns
            if self._over_ns is None:
                return []
            if at_ns - max(self._over_ns, self._standstill.since_ns) >= rule.still_s * _S:
                return self._stop(StopRun(at_ns, "the robot stands still"))
            if rule.when.signal is not None and at_ns - self._over_ns >= _TAIL_NS:
                return self._stop(StopRun(at_ns, f"its signal was over for {_TAIL_NS // _S} s"))
            return []
        commands: list[Command] = [StopRun(started.at_ns, "the next began")] if self._running else []
        self._running = started.rule
        self._over_ns = at_ns if started.rule.when.signal is None else None
        return [*commands, started]

    def tick(self, now_ns: int) -> list[Command]:
        """Return the commands that the passing of time causes: a robot that sends nothing may be off."""
        if self._running is None or now_ns - self._last_sample_ns < _SILENT_NS:
            return []
        return self._stop(StopRun(now_ns, f"the robot was not heard for {_SILENT_NS // _S} s", in_order=False))

    def reset(self) -> None:
        """Forget the run that was asked for, since it was refused or ended otherwise; the next event starts another
        recording."""
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
    """Finds since when the robot stands where it is."""

    def __init__(self) -> None:
        self.since_ns = 0
        self._at: Sequence[float] = (math.inf,) * AXES

    def feed(self, joints: Sequence[float], at_ns: int) -> None:
        if _apart(joints, self._at) > STILL_DEG:
            self._at, self.since_ns = joints, at_ns


class _SettledSignal:
    """Holds the last settled value of the signal."""

    def __init__(self) -> None:
        self.value = math.nan
        self._next = math.nan
        self._since_ns = 0

    def feed(self, value: float, at_ns: int) -> int | None:
        """Return when the signal changed, once it has settled; None for no change and for the first value."""
        if value == self.value:
            self._next = math.nan
            return None
        if value != self._next:  # nan never equals itself, and so never settles
            self._next, self._since_ns = value, at_ns
        if at_ns - self._since_ns < _SETTLED_NS:
            return None
        first = math.isnan(self.value)
        self.value, self._next = value, math.nan
        return None if first else self._since_ns


class _Departure:
    """Detects that the robot stood at one posture and is on its way to another."""

    def __init__(self, when: When) -> None:
        self._from, self._to = when.from_deg or (), when.to_deg or ()
        self._way = math.dist(self._from, self._to)
        self._left_ns: int | None = None

    def feed(self, joints: Sequence[float], stands_since_ns: int, at_ns: int) -> int | None:
        """Return when the robot left, once it is past the middle of the way; None otherwise."""
        if _apart(joints, self._from) <= NEAR_DEG:
            if at_ns - stands_since_ns >= _STOOD_NS:
                self._left_ns = at_ns
            return None
        left_ns = self._left_ns
        arrives = math.dist(joints, self._to) < self._way / 2
        if arrives or math.dist(joints, self._from) > 2 * self._way:
            self._left_ns = None
        return left_ns if arrives else None


def _apart(a_deg: Sequence[float], b_deg: Sequence[float]) -> float:
    return max(abs(a - b) for a, b in zip(a_deg, b_deg, strict=True))


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
