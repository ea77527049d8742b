"""The trigger: what the robot does becomes commands to start and end recordings. Samples in, commands out.

It owns no clock, recorder or thread, so an hour of a cell is tested in milliseconds. It knows the rules of a rig file,
the robot's six angles and its signal, and nothing of arms.

A signal starts a recording by changing to a rule's value: one that is on when it is first received began at an
unknown time. It must stay for 0.1 s, since outputs that together make a number do not switch together. A motion
starts one by leaving a posture in which the robot stood, towards another. Either ends the run before it: a run for each
program that is driven.
A run ends when the robot stands still once the signal is over; where it drives on, soon after. The readings that lie
too early or too late in a run do no harm (the lap is found in it), those that are missing do.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from daq.protocol.conversation import Sample
from rigs.schema.recording_rules import NEAR_DEG, Rule, When

_S = 1_000_000_000
_SETTLED_NS = _S // 10
_STOOD_NS = 3 * _S // 10
"""A robot that only passes its start posture does not stand there."""
_TAIL_NS = 10 * _S
"""A robot that drives on when its signal is over: the run ends without its standing still."""
_SILENT_NS = 10 * _S
_STILL_DEG = 0.02
"""Encoders at rest flicker by less; the slowest circle moves some joint by more in a second."""
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
        if _apart(joints, self._at) > _STILL_DEG:
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
