"""The instrument's end of a serial line on a pty.

A pty passes bytes at once, whatever baud it is set to. A real line takes one character time for each, and
that decides the stamps; so the delay is added here, a character at a time, on an absolute schedule. A pty keeps the
baud that its far end was set to, though not data bits and parity: at another baud than the line's, both ends
hear nonsense.
"""

from __future__ import annotations

import os
import select
import termios
import time
import tty

from daq.emulators.uart import heard
from daq.links import LinkLost
from rigs.links import Line

_SPEEDS = {getattr(termios, name): int(name[1:]) for name in dir(termios) if name[0] == "B" and name[1:].isdigit()}
_ISPEED, _OSPEED = 4, 5
"""Places in what tcgetattr gives."""


class PtyLine:
    """A pty whose far end, `port`, a program opens as its serial port."""

    def __init__(self, line: Line) -> None:
        self._line = line
        self._character_ns = line.character_ns
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self._set_baud()
        os.set_blocking(self._master, False)
        self.port = os.ttyname(self._slave)
        self._free_ns = 0

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
        far = self._far_line()
        return heard(data, far, self._line) if far else data

    def write(self, data: bytes) -> None:
        """Send character by character; returns when the line is free again. What nobody reads is lost."""
        if far := self._far_line():
            data = heard(data, self._line, far)
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

    def _set_baud(self) -> None:
        """For whoever opens the far end without setting any; a baud that has no name stays unset."""
        speed = next((speed for speed, baud in _SPEEDS.items() if baud == self._line.baud), None)
        if speed is not None:
            settings = termios.tcgetattr(self._slave)
            settings[_ISPEED] = settings[_OSPEED] = speed
            termios.tcsetattr(self._slave, termios.TCSANOW, settings)

    def _far_line(self) -> Line | None:
        """The far end's settings where its baud is another one."""
        baud = _SPEEDS.get(termios.tcgetattr(self._slave)[_OSPEED])
        same = baud in (None, self._line.baud) or self._line.baud not in _SPEEDS.values()
        return None if same else Line.model_validate(f"{baud} 8N1")

    def close(self) -> None:
        """Unplug."""
        os.close(self._master)
        os.close(self._slave)
