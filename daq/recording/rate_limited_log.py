"""Warnings that would come in floods, told now and then with how many were not."""

from __future__ import annotations

import logging
import time

log = logging.getLogger("rigd")
_QUIET_S = 10.0
_SLOW_S = 2.0


class QuietLog:
    """The log of one daemon; the streams and kinds are few, and so is what it keeps."""

    def __init__(self) -> None:
        self._told: dict[tuple[str, str], tuple[float, int]] = {}

    def tell(self, name: str, kind: str, detail: str, count: int = 1) -> None:
        """Log a fault, the same kind again at most every ten seconds, with how many were not told.

        What says more of one that was told (count 0) comes once by itself.
        """
        if not count:
            log.info("%s: %s", name, detail)
            return
        told_at, untold = self._told.get((name, kind), (-1e9, 0))
        now = time.monotonic()
        if now - told_at < _QUIET_S:
            self._told[name, kind] = (told_at, untold + count)
            return
        more = f" ({untold} more since the last such line)" if untold else ""
        log.warning("%s: %s: %s%s", name, kind, detail, more)
        self._told[name, kind] = (now, 0)

    def slow(self, what: str, seconds: float) -> None:
        """Tell what the disk takes its time for, where it does."""
        if seconds > _SLOW_S:
            self.tell("disk", f"slow {what}", f"has taken {seconds:.1f} s; readers do not wait for it")
