"""What happens to the computer itself: its wall clock is set, it sleeps, or rigd stands still."""

from __future__ import annotations

from collections import Counter

from daq.acquisition.host_clock import HOST, HostClockMonitor, read_clocks
from daq.acquisition.stall_watch import StallWatch
from daq.protocol.conversation import Fault
from daq.recording.rate_limited_log import RateLimitedLog


class HostWatch:
    """Finds faults of the computer, logs them and counts them by kind since the daemon started."""

    def __init__(self, warnings: RateLimitedLog) -> None:
        self._warnings = warnings
        self._clock, self._stalls = HostClockMonitor(read_clocks()), StallWatch()
        self.counts: Counter[str] = Counter()

    def start(self) -> None:
        """Watch for stalls from now on."""
        self._stalls.start()

    def stop(self) -> None:
        """End the watch for stalls."""
        self._stalls.stop()

    def check(self) -> list[Fault]:
        """Return the faults since the last check."""
        faults = self._clock.check(read_clocks()) + self._stalls.take()
        self._warnings.warn_faults(HOST, faults)
        self.counts.update(fault.kind for fault in faults)
        return faults
