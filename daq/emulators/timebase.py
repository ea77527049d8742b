"""Common timebase of a replay, and the timing accuracy of each instrument."""

from __future__ import annotations

import math
import statistics
import threading
from collections.abc import Callable, Sequence
from itertools import pairwise

from daq.wire.capture import CaptureMark, Piece

_HEAD_START_NS = 100_000_000
"""Delay of the replay relative to the capture.

The threads of the host start about 10 ms after the ports open, or later on a busy computer. An early request waits; a
late request costs a reading.
"""
_SHARE = 0.5
"""Share of the standard uncertainty of the relative time between gauges and robot: smaller than the u of a figure."""
_HOST_NS = 200_000
"""Timing accuracy of any program. All instruments of a replay have the same delay."""
_PUNCTUAL = 10
_SECOND_NS = 1_000_000_000


class Timebase:
    """Host time of each instant of a capture. Thread-safe.

    Instruments that wait for the host individually would drift relative to each other. The timebase starts with the
    first data of the host on any link, and restarts if the host leaves before the end. turn: number of restarts.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self.turn = 0
        self.shift_ns: int | None = None
        """Host time minus capture time; None before the start."""

    def begin(self, now_ns: int, at_ns: int) -> None:
        """The host now performs the action captured at `at_ns`. Only the first call has an effect."""
        with self._lock:
            if self.shift_ns is None:
                self.shift_ns = now_ns - at_ns + _HEAD_START_NS

    def restart(self, turn: int) -> None:
        with self._lock:
            if turn == self.turn:
                self.turn += 1
                self.shift_ns = None


class Steps:
    """Timing deviation of a stream per second.

    Answers are evaluated by the median. Unprompted data is evaluated by the most punctual tenth, as in the analysis: a
    piece delayed by the computer is late as in any recording.
    """

    def __init__(
        self, bearable_ns: float, *, asked: bool, out_of_step: Callable[[float], None] = lambda off_ns: None
    ) -> None:
        """out_of_step: called with the deviation in ns of each second above `bearable_ns`."""
        self._asked = asked
        self.bearable_ns = bearable_ns
        self._out_of_step = out_of_step
        self._second = -1
        self._offs_ns: list[float] = []
        self.judged_ns: list[float] = []
        self.seconds_out = 0
        self.otherwise = 0
        """Number of pieces from the host that differ from the capture or are missing."""
        self.skipped = 0
        """Number of captured answers not requested in time."""
        self.repeated = 0
        """Number of repeated answers, because the host sent more requests than captured."""

    def record_delay(self, at_ns: int, off_ns: float) -> None:
        """Add the delay of a piece of this instant; negative if early."""
        if at_ns // _SECOND_NS != self._second:
            self.judge()
            self._second = at_ns // _SECOND_NS
        self._offs_ns.append(off_ns)

    def judge(self) -> None:
        if not self._offs_ns:
            return
        self._offs_ns.sort()
        off_ns = self._offs_ns[len(self._offs_ns) // (2 if self._asked else _PUNCTUAL)]
        self._offs_ns.clear()
        self.judged_ns.append(off_ns)
        if abs(off_ns) > self.bearable_ns:
            self.seconds_out += 1
            self._out_of_step(off_ns)

    def words(self) -> str:
        off_ms = statistics.median(self.judged_ns or [0.0]) / 1e6
        counted = {"skipped": self.skipped, "repeated": self.repeated, "s out of step": self.seconds_out}
        return ", ".join([f"{off_ms:+z.1f} ms off", *(f"{count} {event}" for event, count in counted.items() if count)])


def u_asked_ns(pieces: Sequence[Piece]) -> float:
    """Standard uncertainty of the time of an answer, measured anywhere between request and answer.

    This function and the next agree with `analysis.runs.clocks`.
    """
    windows_ns = [
        answer.at_ns - question.at_ns
        for question, answer in pairwise(pieces)
        if (question.mark, answer.mark) == (CaptureMark.SENT, CaptureMark.CAME)
    ]
    return statistics.median(windows_ns or [0]) / math.sqrt(12)


def u_cycle_ns(pieces: Sequence[Piece]) -> float:
    """Standard uncertainty of the time of a streamed position, latched anywhere in the cycle."""
    came_ns = [piece.at_ns for piece in pieces if piece.mark is CaptureMark.CAME]
    return statistics.median([after - before for before, after in pairwise(came_ns)] or [0]) / math.sqrt(3)


def bearable_ns(u_gauges_ns: Sequence[float], u_robot_ns: float) -> float:
    return max(_SHARE * math.hypot(max(u_gauges_ns), u_robot_ns), _HOST_NS)
