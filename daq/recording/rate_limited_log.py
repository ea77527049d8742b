"""Warnings that would come in floods, told now and then with how many were not."""

from __future__ import annotations

import logging
import time

log = logging.getLogger("rigd")
_INTERVAL_S = 10.0
_SLOW_S = 2.0


class RateLimitedLog:
    """The log of one daemon; the streams and kinds are few, and so is what it keeps."""

    def __init__(self) -> None:
        self._last: dict[tuple[str, str], tuple[float, int]] = {}

    def warn(self, name: str, kind: str, detail: str, count: int = 1) -> None:
        """Log a fault, the same kind again at most every ten seconds, with how many were not told.

        What says more of one that was told (count 0) comes once by itself.
        """
        if not count:
            log.info("%s: %s", name, detail)
            return
        warned_at, suppressed = self._last.get((name, kind), (-1e9, 0))
        now = time.monotonic()
        if now - warned_at < _INTERVAL_S:
            self._last[name, kind] = (warned_at, suppressed + count)
            return
        more = f" ({suppressed} more since the last such line)" if suppressed else ""
        log.warning("%s: %s: %s%s", name, kind, detail, more)
        self._last[name, kind] = (now, 0)

    def warn_slow(self, what: str, seconds: float) -> None:
        """Tell what the disk takes its time for, where it does."""
        if seconds > _SLOW_S:
            self.warn("disk", f"slow {what}", f"has taken {seconds:.1f} s; readers do not wait for it")
