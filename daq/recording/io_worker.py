"""Threads that wait for the disk: one executes disk operations in order, and a second creates runs.

Each operation may take seconds on a slow disk, while the recorder continues.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from concurrent.futures import Future

from daq import clock
from daq.recording.warnings import RateLimitedLog
from daq.store import RunWriter
from daq.store.run_directory import keep_large_blocks_apart, load_all_of_arrow
from daq.store.writer import DiskOperation

_SYNC_S = 0.5


class IoWorker:
    def __init__(self, warnings: RateLimitedLog) -> None:
        keep_large_blocks_apart()
        load_all_of_arrow()
        self._warnings = warnings
        self._thread = clock.one_thread("disk")
        self._creator = clock.one_thread("begin")
        self._under_way: tuple[DiskOperation, Future[None]] | None = None
        self._begun_s = self._synced_s = 0.0
        self.synced: Mapping[str, int] = {}
        """Rows per sample stream of the current run that are safely on the disk."""

    def advance(self, writer: RunWriter) -> None:
        """Collect finished operations, and start the next one.

        A sync runs twice a second. Chunks are closed between two syncs.
        """
        closed_one = False
        if self._under_way is not None:
            work, waiting = self._under_way
            closed_one = work.synced is None
            self._warnings.warn_slow("closing of a chunk" if closed_one else "sync", clock.now_s() - self._begun_s)
            if not waiting.done():
                return
            self._under_way = None
            writer.end_work(waiting.exception())
            self.synced = self.synced if work.synced is None else work.synced
        now, following = clock.now_s(), None if closed_one else writer.begin_roll()
        if following is None and now - self._synced_s >= _SYNC_S:
            self._synced_s, following = now, writer.begin_sync()
        if following is not None:
            self._begun_s, self._under_way = now, (following, self._thread.submit(following.wait))

    def submit_close(self, close: Callable[[], None]) -> None:
        """Close the run after the pending operation, whose work it verifies and repeats if necessary."""
        self._under_way, self.synced = None, {}
        self._thread.submit(close).add_done_callback(_fail)

    def submit_create(self, create: Callable[[], None]) -> None:
        self._creator.submit(create).add_done_callback(_fail)

    def shut_down(self) -> None:
        self._creator.shutdown()
        self._thread.shutdown()


def _fail(done: Future[None]) -> None:
    """End the process after a programming error, as in any thread."""
    if error := done.exception():
        thread = threading.current_thread()
        threading.excepthook(threading.ExceptHookArgs((type(error), error, error.__traceback__, thread)))
