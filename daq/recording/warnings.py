"""Log messages of the recorder: repeated faults, lost samples, and faults of the computer."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Mapping, Sequence

from daq import clock
from daq.acquisition.host_clock import HOST, HostClockMonitor, StallWatch, read_clocks
from daq.acquisition.stream_buffer import StreamBuffer
from daq.protocol.conversation import Fault, FaultKind

log = logging.getLogger("rigd")
_INTERVAL_S = 10.0
_SLOW_S = 2.0


class RateLimitedLog:
    def __init__(self) -> None:
        self._last: dict[tuple[str, str], tuple[float, int]] = {}

    def warn(self, name: str, kind: str, detail: str, count: int = 1) -> None:
        """Log a fault: a repeated kind again after ten seconds, one with count 0, which adds details, at once."""
        if not count:
            log.info("%s: %s", name, detail)
            return
        warned_at, suppressed = self._last.get((name, kind), (-1e9, 0))
        now = clock.now_s()
        if now - warned_at < _INTERVAL_S:
            self._last[name, kind] = (warned_at, suppressed + count)
            return
        repeated = f" ({suppressed} similar warnings suppressed)" if suppressed else ""
        log.warning("%s: %s: %s%s", name, kind, detail, repeated)
        self._last[name, kind] = (now, 0)

    def warn_faults(self, name: str, faults: Sequence[Fault]) -> None:
        for fault in faults:
            self.warn(name, fault.kind, fault.detail, fault.count)

    def warn_slow(self, action: str, seconds: float) -> None:
        if seconds > _SLOW_S:
            self.warn("disk", f"slow {action}", f"has taken {seconds:.1f} s; readers are not affected")


class Losses:
    def __init__(self, buffers: Mapping[str, StreamBuffer], warnings: RateLimitedLog) -> None:
        self._buffers, self._warnings = buffers, warnings
        self.counts: Counter[str] = Counter()

    def add(self, samples: Counter[str], why: str) -> None:
        self.counts += samples
        for name, count in (+samples).items():
            detail = f"{count} samples were not recorded: {why}"
            self.report(name, [Fault(FaultKind.DROPPED, clock.now_ns(), detail, count)])

    def report(self, name: str, faults: Sequence[Fault]) -> None:
        self._warnings.warn_faults(name, faults)
        self._buffers[name].count(faults)


class HostWatch(StallWatch):
    def __init__(self, warnings: RateLimitedLog) -> None:
        super().__init__()
        self._warnings, self._clocks = warnings, HostClockMonitor(read_clocks())
        self.counts: Counter[str] = Counter()

    def check(self) -> list[Fault]:
        faults = self._clocks.check(read_clocks()) + self.take()
        self._warnings.warn_faults(HOST, faults)
        self.counts.update(fault.kind for fault in faults)
        return faults
