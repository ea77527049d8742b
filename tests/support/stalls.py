"""How long a byte is held up on its way through a pty: whether a lap with a hole is the computer's fault.

A kernel passes such bytes on by threads of its own, and where other programs want all of a computer they starve for up
to seconds. The bytes are sent from the process of the test, in which the emulated instruments live, so what holds those
up is measured too.
"""

from __future__ import annotations

import os
import select
import threading
import time
import tty

_PACE_S = 0.002
_LONGEST_S = 10.0
"""A byte that takes longer is not waited for: far more than any test takes for a stall."""


class Stalls(threading.Thread):
    """Sends bytes through a pty as long as it is entered; worst_s: the longest that one took, or came too late."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.worst_s = 0.0
        self._over = threading.Event()

    def __enter__(self) -> Stalls:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self.join(_LONGEST_S)

    def run(self) -> None:
        master, slave = os.openpty()
        tty.setraw(slave)
        due = time.monotonic() + _PACE_S
        over = False
        while not over:
            over = self._over.wait(_PACE_S)  # and once more at the end: a stall may have been the last that happened
            os.write(master, b"x")
            if select.select([slave], [], [], _LONGEST_S)[0]:
                os.read(slave, 1)
            now = time.monotonic()
            late_s, due = now - due, now + _PACE_S
            self.worst_s = max(self.worst_s, late_s)
        os.close(master)
        os.close(slave)
