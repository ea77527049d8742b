"""Faults for well-formed but implausible readings, reported while the operator can still react.

A *stuck* gauge repeats a value while the robot moves, in a test with permanent contact. A real probe always varies,
except a coarse one: a fault requires `STUCK_S`, `STUCK_READINGS` and `STUCK_DEG` of motion, and `COARSE_DEG` if no step
finer than `COARSE_MM` was seen. A gauge that *hung* was constant for `HELD_S` while the robot moved by `HELD_DEG`, and
then jumped. The checks are pure and change no reading.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from daq.acquisition.stream_buffer import samples_of
from daq.protocol.conversation import NO_SAMPLES, Fault, FaultKind, Item, SampleBlock

STUCK_S = 10.0
STUCK_READINGS = 20
STUCK_DEG = 20.0
COARSE_DEG = 90.0
COARSE_MM = 0.002
TIMES_IN_ERROR = 5
IN_ERROR_S = 60.0
HELD_S = 0.5
HELD_READINGS = 5
HELD_DEG = 1.0
HELD_STEPS = 5.0
"""Multiple of the usual step by which a reading must differ after a constant value; a reversal gives a single step."""
INCH_MM = 25.4
BEFORE, AFTER = 9, 3
"""Readings that show the usual motion before a change of unit, and that exclude a single wrong reading after it."""
_STILL_DEG = 0.1


@dataclass
class _GaugeState:
    reading: float = math.nan
    since_ns: int = 0
    count: int = 0
    travel_deg: float = 0.0
    finest_mm: float = math.inf
    reported: bool = False
    last_ns: int = 0
    """Time of the latest reading with the current value."""
    steps_mm: deque[float] = field(default_factory=lambda: deque(maxlen=20))
    tail: SampleBlock = NO_SAMPLES
    """Readings to be searched for a change of unit, with some earlier readings."""


@dataclass
class PlausibilityCheck:
    """Checks the streams of a recording. touching: the gauges remain in contact throughout the test."""

    touching: bool
    _gauges: dict[str, _GaugeState] = field(default_factory=dict)
    _joints: tuple[float, ...] = ()
    _travel_deg: float = 0.0
    _errors: dict[str, deque[int]] = field(default_factory=dict)
    _in_error: dict[str, set[int | None]] = field(default_factory=dict)
    """Columns of the gauges in error, by stream. None is an error while messages are incomplete."""

    def check(self, stream: str, columns: Sequence[str], items: Sequence[Item]) -> list[Fault]:
        samples = samples_of(items)
        if "q1_deg" in columns:
            if len(samples):  # motion of the fastest joint; a single check per call is sufficient
                joints = samples[-1].values[:6]  # a signal may follow
                moved_deg = max((abs(b - a) for a, b in zip(self._joints, joints, strict=False)), default=math.inf)
                if moved_deg > _STILL_DEG:
                    self._travel_deg += moved_deg if self._joints else 0.0
                    self._joints = joints
            return []
        doubts = self._intermittent(stream, columns, items)
        for place, column in enumerate(columns):
            gauge = self._gauges.setdefault(column, _GaugeState())
            doubts += _rescaled(column, gauge, samples, place)
            if self.touching:
                doubts += self._update(column, gauge, samples, place)
                doubts += self._sticking(column, gauge, samples)
        return doubts

    def _update(self, column: str, gauge: _GaugeState, samples: SampleBlock, place: int) -> list[Fault]:
        good = ~np.isnan(samples.values[:, place]) if len(samples) else np.zeros(0, bool)
        readings_mm, stamps_ns = samples.values[good, place] if good.any() else np.empty(0), samples.last_byte_ns[good]
        steps_mm = np.abs(np.diff(readings_mm, prepend=gauge.reading))
        (moved,) = np.nonzero(steps_mm != 0)  # nan, the step to the very first reading, counts as a motion
        if not moved.size:
            gauge.count += len(readings_mm)
            gauge.last_ns = int(stamps_ns[-1]) if len(stamps_ns) else gauge.last_ns
            return []
        freed = [_doubtful(int(stamps_ns[moved[0]]), f"{_name(column)} moves again", 0)] if gauge.reported else []
        if moved[0] > 0:
            gauge.last_ns = int(stamps_ns[moved[0] - 1])
        freed += self._check_stuck_gauge(
            column, gauge, gauge.count + int(moved[0]), int(stamps_ns[moved[0]]), steps_mm[moved[0]]
        )
        gauge.steps_mm.extend(steps_mm[moved[-20:]][np.isfinite(steps_mm[moved[-20:]])])
        gauge.finest_mm = float(np.fmin.reduce(steps_mm[moved], initial=gauge.finest_mm))
        last = int(moved[-1])
        gauge.reading, gauge.since_ns, gauge.reported = float(readings_mm[last]), int(stamps_ns[last]), False
        gauge.count, gauge.travel_deg = len(readings_mm) - last, self._travel_deg
        gauge.last_ns = int(stamps_ns[-1])
        return freed

    def _check_stuck_gauge(
        self, column: str, gauge: _GaugeState, count: int, now_ns: int, jump_mm: float
    ) -> list[Fault]:
        seconds, moved_deg = (gauge.last_ns - gauge.since_ns) / 1e9, self._travel_deg - gauge.travel_deg
        if gauge.reported or seconds < HELD_S or count < HELD_READINGS or moved_deg < HELD_DEG:
            return []
        if len(gauge.steps_mm) < HELD_READINGS or jump_mm <= HELD_STEPS * float(np.median(gauge.steps_mm)):
            return []
        detail = (
            f"{_name(column)} showed exactly {gauge.reading:.4f} mm for {seconds:.1f} s while the robot moved "
            f"{moved_deg:.0f}°, then jumped by {jump_mm:.4f} mm: check that HOLD was not pressed and that the cable is "
            "connected"
        )
        return [_doubtful(now_ns, detail)]

    def _sticking(self, column: str, gauge: _GaugeState, samples: SampleBlock) -> list[Fault]:
        if gauge.reported or not len(samples) or gauge.count < STUCK_READINGS:
            return []
        now_ns = samples[-1].last_byte_ns
        seconds, moved_deg = (now_ns - gauge.since_ns) / 1e9, self._travel_deg - gauge.travel_deg
        if seconds < STUCK_S or moved_deg < (STUCK_DEG if gauge.finest_mm < COARSE_MM else COARSE_DEG):
            return []
        gauge.reported = True
        detail = (
            f"{_name(column)} has shown exactly {gauge.reading:.4f} mm for {seconds:.0f} s while the robot moved "
            f"{moved_deg:.0f}°: check that the plunger is free and the display is not on HOLD"
        )
        return [_doubtful(now_ns, detail)]

    def _intermittent(self, stream: str, columns: Sequence[str], items: Sequence[Item]) -> list[Fault]:
        in_error, doubts = self._in_error.setdefault(stream, set()), list[Fault]()
        for item in items:
            if not isinstance(item, Fault):
                read = np.isfinite(np.atleast_2d(item.values))
                # Columns of the rows (n, columns) that must be valid to end an error: the column of a gauge, or the
                # complete row
                in_error -= {
                    place
                    for place in in_error
                    if (read if place is None else read[:, place : place + 1]).all(axis=1).any()
                }
            elif item.kind is FaultKind.DEVICE_ERROR and item.column not in in_error:
                in_error.add(item.column)
                # a single gauge, or an instrument with several gauges
                name = stream if item.column is None else _name(columns[item.column])
                times_ns = self._errors.setdefault(name, deque(maxlen=TIMES_IN_ERROR))
                times_ns.append(item.at_ns)
                span_s = (item.at_ns - times_ns[0]) / 1e9
                if len(times_ns) == TIMES_IN_ERROR and span_s <= IN_ERROR_S:
                    times_ns.clear()
                    often = f"{name} went in and out of error {TIMES_IN_ERROR} times in {span_s:.0f} s ({item.detail})"
                    doubts.append(_doubtful(item.at_ns, f"{often}: check that the complete motion is within the range"))
        return doubts


def _rescaled(column: str, gauge: _GaugeState, samples: SampleBlock, place: int) -> list[Fault]:
    read = samples.chosen(~np.isnan(samples.values[:, place])) if len(samples) else samples
    window = SampleBlock.joined([gauge.tail, read])
    gauge.tail = window[-(BEFORE + AFTER - 1) :]
    if len(window) < BEFORE + AFTER:
        return []
    readings_mm = window.values[:, place]
    before_mm, after_mm = readings_mm[BEFORE - 1 : -AFTER], readings_mm[BEFORE : len(readings_mm) - AFTER + 1]
    larger, smaller = np.fmax(abs(before_mm), abs(after_mm)), np.fmin(abs(before_mm), abs(after_mm))
    # few candidates, which are examined individually
    (likely,) = np.nonzero(abs(larger - INCH_MM * smaller) < larger / 2)
    faults = []
    for k in likely:
        if _goes_on_rescaled(readings_mm[k : k + BEFORE], readings_mm[k + BEFORE : k + BEFORE + AFTER]):
            change = f"from {before_mm[k]:.4f} to {after_mm[k]:.4f} mm, a factor of 25.4, and did not return"
            detail = (
                f"{_name(column)} went {change}: did somebody press in/mm? Switch it back, and repeat the recording"
            )
            faults.append(Fault(FaultKind.UNIT_CHANGED, int(window.last_byte_ns[k + BEFORE]), detail))
    return faults


def _goes_on_rescaled(before_mm: NDArray[np.float64], after_mm: NDArray[np.float64]) -> bool:
    step_mm = 2 * float(np.abs(np.diff(before_mm)).max())
    jump_mm = abs(float(after_mm[0] - before_mm[-1]))
    if jump_mm <= 10 * max(step_mm, COARSE_MM):
        return False
    for factor in (INCH_MM, 1 / INCH_MM):
        as_before_mm = after_mm * factor
        rounded_mm = COARSE_MM * max(factor, 1.0)
        led_to = np.abs(np.diff(as_before_mm, prepend=before_mm[-1])) <= step_mm + rounded_mm
        if led_to.all():
            return True
    return False


def _name(column: str) -> str:
    return column.removesuffix("_mm")


def _doubtful(at_ns: int, detail: str, count: int = 1) -> Fault:
    return Fault(FaultKind.DOUBTFUL, at_ns, detail, count)
