"""Ctrl-C at the very end: a program that has done its work has nothing left to be interrupted in."""

from __future__ import annotations

import signal
import threading


def ignore_interrupts() -> None:
    """Ignore Ctrl-C from now on, where this is the program's main thread.

    While Python takes itself down it would print a traceback of its own modules, and end with the exit code 0 of the
    work that is done, or of none.
    """
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)
