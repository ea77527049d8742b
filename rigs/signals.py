"""Handling of Ctrl-C while a program waits for its end, and during its shutdown."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections import deque
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import TypeVar

COMPLETED: deque[Path] = deque(maxlen=1000)
"""The last files and directories that this process put in place, for the message after Ctrl-C."""
REPLACED: set[Path] = set()
"""Pages, pictures and tables that existed when this process was about to write them, for the message about it."""
_POLL_S = 0.5
_End = TypeVar("_End")


def end_from(ends: SimpleQueue[_End]) -> _End:
    """First end put into a queue by a signal handler or thread.

    It wakes up twice a second: the system may deliver a signal to any thread, and a main thread sleeping in a lock runs
    no handler.
    """
    while True:
        with contextlib.suppress(Empty):
            return ends.get(timeout=_POLL_S)


def ignore_interrupts() -> None:
    """Ignore Ctrl-C from now on: during shutdown Python would print a traceback and exit with a misleading code."""
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)
