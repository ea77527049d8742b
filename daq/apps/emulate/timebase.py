"""The one time of a replay, and how well each of its instruments keeps it.

What an instrument said t seconds after the capture's start it says t seconds after the replay's, whenever it is asked.
Instruments that waited for the host each by itself would drift against one another, and no figure would survive that.
"""

from __future__ import annotations

import math
import statistics
import threading
from collections.abc import Callable, Sequence
from itertools import pairwise

from daq.wire.capture import Mark, Piece

_HEAD_START_NS = 100_000_000
"""How much later than in the capture the host hears everything. Its threads start some 10 ms after its ports are open,
more on a busy computer. A request that comes too early waits for its time; one that comes too late costs a reading."""
_SHARE = 0.5
"""Share of the standard uncertainty of the gauges' time against the robot's: such an error moves a figure by less than
its u."""
_HOST_NS = 200_000
"""No program is woken any more punctually than this, and all instruments of a replay are late alike."""
_PUNCTUAL = 10
_SECOND_NS = 1_000_000_000


class Timebase:
    """The host's time of each instant of a capture; thread-safe.

    It begins with the first word of the host on any link. When the host goes away before the end it is set back, and
    everything restarts with the next message: `turn` counts that.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self.turn = 0
        self.shift_ns: int | None = None
        """Host's time less the capture's; None until it begins."""

    def begin(self, now_ns: int, at_ns: int) -> None:
        """Note that the host does now what it did at `at_ns` in the capture; only the first call counts."""
        with self._lock:
            if self.shift_ns is None:
                self.shift_ns = now_ns - at_ns + _HEAD_START_NS

    def is_past(self, now_ns: int, at_ns: int) -> bool:
        """Return whether this instant of the capture is over."""
        return self.shift_ns is not None and now_ns > self.shift_ns + at_ns

    def restart(self, turn: int) -> None:
        """Restart, since the host has left in this turn."""
        with self._lock:
            if turn == self.turn:
                self.turn += 1
                self.shift_ns = None


class Steps:
    """Measures how far one stream is from its time, second by second.

    Answers are judged by their median. What comes unasked is judged by its most punctual tenth, since the analysis goes
    by those: a piece that the computer held up is late as any host meets them.
    """

    def __init__(
        self, bearable_ns: float, *, asked: bool, out_of_step: Callable[[float], None] = lambda off_ns: None
    ) -> None:
        """out_of_step: is called with how much, in ns, each second was off that was further off than `bearable_ns`."""
        self._asked = asked
        self.bearable_ns = bearable_ns
        self._out_of_step = out_of_step
        self._second = -1
        self._offs_ns: list[float] = []
        self.judged_ns: list[float] = []
        """How far each second was off."""
        self.seconds_out = 0
        self.otherwise = 0
        """Pieces that the host sent otherwise than it was captured, or not at all."""
        self.skipped = 0
        """Answers of the capture that were not requested in time."""
        self.repeated = 0
        """Answers that were given again, because the host asked more often than it was captured."""

    def said(self, at_ns: int, off_ns: float) -> None:
        """Note by how much a piece of this instant was late, or early if negative."""
        if at_ns // _SECOND_NS != self._second:
            self.judge()
            self._second = at_ns // _SECOND_NS
        self._offs_ns.append(off_ns)

    def judge(self) -> None:
        """Judge the second that is over."""
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
        """Return the result in words."""
        off_ms = statistics.median(self.judged_ns or [0.0]) / 1e6
        counted = {"skipped": self.skipped, "repeated": self.repeated, "s out of step": self.seconds_out}
        return ", ".join([f"{off_ms:+.1f} ms off", *(f"{count} {event}" for event, count in counted.items() if count)])


def u_asked_ns(pieces: Sequence[Piece]) -> float:
    """Return the standard uncertainty of the time of an answer: measured anywhere between request and answer.

    This and the next as the analysis has them, in `analysis.runs.clocks`.
    """
    windows_ns = [
        answer.at_ns - question.at_ns
        for question, answer in pairwise(pieces)
        if (question.mark, answer.mark) == (Mark.SENT, Mark.CAME)
    ]
    return statistics.median(windows_ns or [0]) / math.sqrt(12)


def u_cycle_ns(pieces: Sequence[Piece]) -> float:
    """Return the standard uncertainty of the time of a position that is streamed: latched anywhere in its cycle."""
    came_ns = [piece.at_ns for piece in pieces if piece.mark is Mark.CAME]
    return statistics.median([after - before for before, after in pairwise(came_ns)] or [0]) / math.sqrt(3)


def bearable_ns(u_gauges_ns: Sequence[float], u_robot_ns: float) -> float:
    """Return how far a second of a replay may be off."""
    return max(_SHARE * math.hypot(max(u_gauges_ns), u_robot_ns), _HOST_NS)
