"""A log of repeated warnings: each kind is logged at most every ten seconds, with the number of those left out."""

from __future__ import annotations

import logging
from collections.abc import Sequence

from daq import clock
from daq.protocol.conversation import Fault

log = logging.getLogger("rigd")
_INTERVAL_S = 10.0
_SLOW_S = 2.0


class RateLimitedLog:
    """Logs the faults of one daemon; streams and kinds are few, and so is what it remembers."""

    def __init__(self) -> None:
        self._last: dict[tuple[str, str], tuple[float, int]] = {}

    def warn(self, name: str, kind: str, detail: str, count: int = 1) -> None:
        """Log a fault; the same kind is logged again after ten seconds at the earliest, with the number left out.

        A fault of count 0, which adds details to an earlier one, is logged at once.
        """
        if not count:
            log.info("%s: %s", name, detail)
            return
        warned_at, suppressed = self._last.get((name, kind), (-1e9, 0))
        now = clock.now_s()
        if now - warned_at < _INTERVAL_S:
            self._last[name, kind] = (warned_at, suppressed + count)
            return
        more = f" ({suppressed} more since the last such line)" if suppressed else ""
        log.warning("%s: %s: %s%s", name, kind, detail, more)
        self._last[name, kind] = (now, 0)

    def warn_faults(self, name: str, faults: Sequence[Fault]) -> None:
        """Log faults of one stream."""
        for fault in faults:
            self.warn(name, fault.kind, fault.detail, fault.count)

    def warn_slow(self, what: str, seconds: float) -> None:
        """Log what the disk has been slow with, if it was."""
        if seconds > _SLOW_S:
            self.warn("disk", f"slow {what}", f"has taken {seconds:.1f} s; readers do not wait for it")
