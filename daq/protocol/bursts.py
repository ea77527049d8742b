"""Reporting a fault that keeps coming once a second instead of a thousand times.

The first is reported at once. Those that follow without a message free of it in between are counted, and reported
as one when they end or a second has passed. What has its own count or its own pace (SILENT, LATE, SKIPPED) passes
unchanged.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from daq.protocol.conversation import Fault, FaultKind, Item

_REPEATING = {
    FaultKind.GARBLED,
    FaultKind.MISSHAPEN,
    FaultKind.UNIT_CHANGED,
    FaultKind.DEVICE_ERROR,
    FaultKind.MISSING,
    FaultKind.STRANGER,
}
_SAME = {FaultKind.GARBLED, FaultKind.MISSHAPEN}
"""Kinds whose text quotes the message: they are the same whatever it was."""
_TELL_NS = 1_000_000_000


class Bursts:
    """Merges the faults of successive messages."""

    def __init__(self) -> None:
        self._open: dict[tuple[FaultKind, str], Fault] = {}
        """Open faults by what makes two of them the same; the count is of those not reported yet."""

    def merge(self, items: Sequence[Item], now_ns: int) -> list[Item]:
        """Return the items of one message, with repeated faults held back and those that are due added."""
        if not self._open and not any(isinstance(item, Fault) for item in items):
            return list(items)
        coming = {_sameness(item) for item in items if isinstance(item, Fault)}
        merged = [fault for key in list(self._open) if key not in coming for fault in self._close(key)]
        for item in items:
            if not isinstance(item, Fault) or item.kind not in _REPEATING:
                merged.append(item)
            elif (key := _sameness(item)) not in self._open:
                merged.append(item)
                self._open[key] = replace(item, at_ns=now_ns, count=0)
            else:
                merged += self._again(key, item.count, now_ns)
        return merged

    def end(self) -> list[Item]:
        """Return the faults that are still held back."""
        return [fault for key in list(self._open) for fault in self._close(key)]

    def _again(self, key: tuple[FaultKind, str], count: int, now_ns: int) -> list[Item]:
        fault = replace(self._open[key], count=self._open[key].count + count)
        due = now_ns - fault.at_ns >= _TELL_NS
        self._open[key] = replace(fault, at_ns=now_ns, count=0) if due else fault
        return [fault] if due else []

    def _close(self, key: tuple[FaultKind, str]) -> list[Item]:
        fault = self._open.pop(key)
        return [fault] if fault.count else []


def _sameness(fault: Fault) -> tuple[FaultKind, str]:
    return fault.kind, "" if fault.kind in _SAME else fault.detail
