"""Measure delays of bytes in a pty, to decide whether the computer caused a gap in a lap.

A kernel forwards such bytes in its own threads, which may starve for seconds under heavy load. The bytes are sent by
the process of the test, which also runs the emulated instruments, so stalls of the process are measured too.
"""

from __future__ import annotations

import os
import select
import threading
import time
import tty

_PACE_S = 0.002
_LONGEST_S = 10.0
"""Longest wait for a byte, far more than any test accepts as a stall."""


class Stalls(threading.Thread):
    """Thread that sends bytes through a pty within the context. worst_s: longest delay of a byte or of its sending."""

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
            over = self._over.wait(_PACE_S)  # and once more at the end, in case of a final stall
            os.write(master, b"x")
            if select.select([slave], [], [], _LONGEST_S)[0]:
                os.read(slave, 1)
            now = time.monotonic()
            late_s, due = now - due, now + _PACE_S
            self.worst_s = max(self.worst_s, late_s)
        os.close(master)
        os.close(slave)
