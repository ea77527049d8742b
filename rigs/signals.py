"""Ctrl-C while a program waits for its end, and at the very end, when it has nothing left to be interrupted in."""

from __future__ import annotations

import contextlib
import signal
import threading
from queue import Empty, SimpleQueue
from typing import TypeVar

_LOOK_S = 0.5
_End = TypeVar("_End")


def end_from(ends: SimpleQueue[_End]) -> _End:
    """Return the first end that a handler of signals, or another thread, puts into a queue.

    The system may hand a signal to any thread, and a main thread that sleeps in a lock runs no handler until it wakes:
    of a hundred daemons on a busy computer two did not end by Ctrl-C. So this looks twice a second.
    """
    while True:
        with contextlib.suppress(Empty):
            return ends.get(timeout=_LOOK_S)


def ignore_interrupts() -> None:
    """Ignore Ctrl-C from now on, where this is the program's main thread.

    While Python takes itself down it would print a traceback of its own modules, and end with the exit code 0 of the
    work that is done, or of none.
    """
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)
