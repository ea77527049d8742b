"""The instrument's end of a serial line on a pty.

A pty passes bytes at once, whatever baud it is set to. A real line takes one character time for each, and
that decides the stamps; so the delay is added here, a character at a time, on an absolute schedule.

An adapter that is unplugged takes its tty with it and comes back on another; what stays is its name under
`/dev/serial/by-id`. So a line may be given such a name: a symbolic link that goes and comes with the tty.
"""

from __future__ import annotations

import os
import select
import time
import tty
from pathlib import Path

from daq.links import LinkLost
from rigs.links import Line


class PtyLine:
    """A pty whose far end, `port`, a program opens as its serial port, by its `name` where it has one."""

    def __init__(self, line: Line, name: Path | None = None) -> None:
        self._character_ns = line.character_ns
        self._name = name
        self._free_ns = 0
        self._master, self._slave = os.openpty()
        self.port = str(name or os.ttyname(self._slave))
        self.plug()

    def plug(self) -> None:
        """Be there, under the name."""
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        if self._name is not None:
            self._name.parent.mkdir(parents=True, exist_ok=True)
            self._name.symlink_to(os.ttyname(self._slave))

    def unplug(self) -> None:
        """Be gone, tty and name, until `plug`, which brings another tty."""
        following = os.openpty()  # before the old one goes, whose number would be given again
        self.close()
        self._master, self._slave = following

    def read(self, timeout_s: float) -> bytes:
        """Bytes from the host, once the line would have carried them all."""
        if not select.select([self._master], [], [], timeout_s)[0]:
            return b""
        try:
            data = os.read(self._master, 4096)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise LinkLost(str(error)) from None
        time.sleep(len(data) * self._character_ns / 1e9)
        return data

    def write(self, data: bytes) -> None:
        """Send character by character; returns when the line is free again. What nobody reads is lost."""
        self._free_ns = max(self._free_ns, time.monotonic_ns())
        sent = 0
        while sent < len(data):
            self._free_ns += self._character_ns
            time.sleep(max(0, self._free_ns - time.monotonic_ns()) / 1e9)
            # A late wake-up sends what is due by now, as a UART would have.
            late = max(0, time.monotonic_ns() - self._free_ns) // self._character_ns
            due = min(1 + late, len(data) - sent)
            self._free_ns += (due - 1) * self._character_ns
            try:
                os.write(self._master, data[sent : sent + due])
            except BlockingIOError:
                pass
            except OSError as error:
                raise LinkLost(str(error)) from None
            sent += due

    def close(self) -> None:
        """Be gone for good."""
        if self._name is not None:
            self._name.unlink(missing_ok=True)
        os.close(self._master)
        os.close(self._slave)
