"""The daemon's slow work, in a thread of its own: the file of metrics, and retention.

Neither readers nor the writer ever wait for it; a disk that hangs holds up this thread alone.
"""

from __future__ import annotations

import contextlib
import logging
import os
import threading
import time
from collections.abc import Callable
from pathlib import Path

from daq.janitor import Janitor
from rigs.errors import CellError

log = logging.getLogger("rigd")
_METRICS_S = 10.0
_RETENTION_S = 600.0


class Housekeeper(threading.Thread):
    """Writes the metrics every ten seconds and goes over the runs every ten minutes, until told to stop."""

    def __init__(self, metrics: Path | None, text: Callable[[], str], janitor: Janitor | None) -> None:
        """Raises CellError where the file of metrics cannot be written."""
        super().__init__(name="keep house", daemon=True)
        self._metrics, self._text, self._janitor = metrics, text, janitor
        self._stop_asked = threading.Event()
        self._told = False
        if metrics is not None:
            try:
                write_whole(metrics, text())
            except OSError as error:
                what = f"cannot be written: {error.strerror or error}"
                raise CellError(str(metrics), what, "give another --metrics") from None

    def stop(self) -> None:
        """Ask the thread to end; join it afterwards."""
        self._stop_asked.set()

    def run(self) -> None:
        """The thread's body."""
        look_at = time.monotonic()
        while not self._stop_asked.is_set():
            if self._janitor is not None and time.monotonic() >= look_at:
                self._janitor.round()
                look_at = time.monotonic() + _RETENTION_S
            self._write_metrics()
            self._stop_asked.wait(_METRICS_S)
        if self._metrics is not None:
            with contextlib.suppress(OSError):
                self._metrics.unlink(missing_ok=True)  # what it says is not so any more

    def _write_metrics(self) -> None:
        if self._metrics is None:
            return
        try:
            write_whole(self._metrics, self._text())
            self._told = False
        except OSError as error:
            if not self._told:
                log.warning("metrics: %s cannot be written: %s", self._metrics, error.strerror or error)
            self._told = True


def write_whole(path: Path, text: str) -> None:
    """Put text under a name all at once; who reads the file finds the old or the new. Raises OSError.

    Not synced: what was measured of a daemon that is gone need not survive a cut of power.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        temporary.write_text(text, encoding="utf-8", errors="replace")  # a path may hold what is no UTF-8
        temporary.replace(path)
    except OSError:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise
