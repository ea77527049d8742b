"""Lost, doubled and overtaken datagrams, seen by the number that each carries.

A sample that comes after a later one, or twice, is ignored and reported as LATE: its time has passed, and a
clock that runs backwards would look like a controller that was started again. What is missing is a SKIPPED fault
with the count; so a sample that was overtaken is reported as missing first and as late when it comes.
"""

from __future__ import annotations

from daq.protocol.conversation import Fault, FaultKind, Item, Sample

_BEHIND = 20
"""Messages that a network may hold one back by. Further back, the counter restarted."""
_AHEAD = 1_000_000
"""Messages that can be lost in a row: an hour. Further ahead, the counter restarted."""


class Order:
    """Checks the numbers of successive messages, which grow by `step` and wrap at `modulus`."""

    def __init__(self, step: int = 1, modulus: int = 2**32) -> None:
        self._step = step
        self._modulus = modulus
        self._last: int | None = None

    def forget(self) -> None:
        """Forget the last number, so that the next message continues nothing."""
        self._last = None

    def admit(self, sample: Sample, number: int) -> tuple[Item, ...]:
        """Return the sample with this number, unless it came too late, and the faults that its number shows."""
        last, at_ns = self._last, sample.last_byte_ns
        if last is None:
            self._last = number
            return (sample,)
        passed = self._passed(last, number)
        if -_BEHIND < passed <= 0:
            what = "came twice" if number == last else f"came after {last}"
            return (Fault(FaultKind.LATE, at_ns, f"datagram {number} {what}; left out; check the network"),)
        self._last = number
        if passed == 1:
            return (sample,)
        if not 0 < passed <= _AHEAD:
            detail = f"the controller's counter goes from {last} to {number}: it restarted, and the loss is unknown"
            return Fault(FaultKind.SKIPPED, at_ns, detail), sample
        detail = f"the controller's counter goes from {last} to {number}; check the network and the host's load"
        return Fault(FaultKind.SKIPPED, at_ns, detail, passed - 1), sample

    def _passed(self, last: int, number: int) -> int:
        """Messages from the last one to this, negative for an earlier one."""
        ahead = (number - last) % self._modulus
        signed = ahead if ahead < self._modulus // 2 else ahead - self._modulus
        # Less than a step ahead is the next all the same: a controller may be quicker than the rig file says.
        return max(1, round(signed / self._step)) if signed > 0 else signed // self._step
