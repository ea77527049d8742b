"""Instrument side of a serial line on a pty.

A pty transfers bytes immediately at any baud rate. The duration of a character, which affects the timestamps, is added
here on an absolute schedule. Characters sent at a wrong baud rate are converted as by a UART; a pty stores the baud
rate of the opposite end, but not data bits and parity.
"""

from __future__ import annotations

import os
import random
import select
import termios
import tty
from collections import deque
from pathlib import Path

from daq import clock
from daq.wire.conversation_loop import ByteLink
from daq.wire.links import LinkLost
from rigs.schema.links import Line

_LOOKS = 16
"""Samples per bit for detecting the start edge of a character in a UART."""


def heard(data: bytes, sent: Line, at: Line) -> bytes:
    """Characters sent with certain line settings, as a receiver with others finds them in the middle of each bit.

    Parity is not checked. A character with a missing stop bit is passed on, as most drivers do.
    """
    received, scale = bytearray(), sent.baud / at.baud
    for character in data:
        bits = [character >> n & 1 for n in range(sent.bits)]
        parity = {"N": [], "E": [sum(bits) % 2], "O": [1 - sum(bits) % 2]}[sent.parity]
        # Levels of the wire in bit times of the receiver: start, data with the lowest bit first, parity, stop, idle.
        levels = [0, *bits, *parity, *[1] * sent.stop]
        now, end = 0.0, len(levels) / scale
        levels += [1] * (3 + int((at.bits + 2) * scale))
        while now < end:
            if levels[int(now * scale)]:
                now += 1 / _LOOKS
                continue
            received.append(sum(levels[int((now + 1.5 + n) * scale)] << n for n in range(at.bits)))
            now += at.bits + 1.5
            while now < end and not levels[int(now * scale)]:  # no stop bit: wait until the wire is idle
                now += 1 / _LOOKS
    return bytes(received)


_PACKET = 62


class LatencyTimer:
    """Latency timer of an FTDI adapter (application note AN232B-04). Times are in ns of any clock.

    Bytes wait until the timer expires, counted from the last packet, or a USB packet of 62 bytes is full. If there is
    no data, a status packet is sent, so the timer continues. With a latency of 0 it delays nothing.
    """

    def __init__(self, latency_ms: float, now_ns: int) -> None:
        self._latency_ns = round(latency_ms * 1e6)
        self._sent_ns = now_ns
        self._held = bytearray()
        self._due_ns = now_ns

    @property
    def due_ns(self) -> int | None:
        return self._due_ns if self._held else None

    def add(self, data: bytes, now_ns: int) -> None:
        if not self._held:
            self._due_ns = now_ns
            if self._latency_ns:
                periods = -(-(now_ns - self._sent_ns) // self._latency_ns)
                self._due_ns = self._sent_ns + max(1, periods) * self._latency_ns
        self._held += data
        if len(self._held) >= _PACKET:
            self._due_ns = now_ns

    def take(self, now_ns: int) -> bytes:
        if not self._held or now_ns < self._due_ns:
            return b""
        data = bytes(self._held)
        self._held.clear()
        self._sent_ns = self._due_ns
        return data


class LateLink:
    """Link with exponentially distributed delays of mean `jitter_ms`, in order."""

    def __init__(self, link: ByteLink, jitter_ms: float, seed: int = 0) -> None:
        self._link = link
        self._rate = 1e-6 / jitter_ms
        self._random = random.Random(seed)
        self._waiting: deque[tuple[int, bytes]] = deque()
        self._last_ns = 0

    def read(self, timeout_s: float) -> bytes:
        until_ns = clock.now_ns() + round(timeout_s * 1e9)
        while True:
            self._send_due()
            next_ns = min(until_ns, self._waiting[0][0]) if self._waiting else until_ns
            data = self._link.read(max(0, next_ns - clock.now_ns()) / 1e9)
            if data or clock.now_ns() >= until_ns:
                return data

    def write(self, data: bytes) -> None:
        self._last_ns = max(self._last_ns, clock.now_ns() + round(self._random.expovariate(self._rate)))
        self._waiting.append((self._last_ns, data))
        self._send_due()

    def set_dtr(self, on: bool) -> None:
        self._link.set_dtr(on)

    def _send_due(self) -> None:
        while self._waiting and self._waiting[0][0] <= clock.now_ns():
            self._link.write(self._waiting.popleft()[1])


_SPEEDS = {getattr(termios, name): int(name[1:]) for name in dir(termios) if name[0] == "B" and name[1:].isdigit()}
_ISPEED, _OSPEED = 4, 5


class PtyLine:
    """A pty. The host opens the opposite end as a serial port, by `port` or by `name`.

    An unplugged adapter loses the tty and returns with a new one, while its name, a symbolic link, stays the same.
    """

    def __init__(self, line: Line, latency_ms: float = 0.0, name: Path | None = None, *, paced: bool = True) -> None:
        """paced: False if the data already has the pace of the line, as from a capture."""
        self._master, self._slave = os.openpty()
        self.port = str(name or os.ttyname(self._slave))
        self._line = line
        self._adapter = LatencyTimer(latency_ms, clock.now_ns())
        self._character_ns = line.character_ns if paced else 0
        self._name = name
        self.free_ns = 0
        self._set_out_ns: int | None = None
        self.plug()

    def plug(self) -> None:
        tty.setraw(self._slave)
        # For programs that open the opposite end with default settings; a baud rate unknown to the system is not set.
        speed = next((speed for speed, baud in _SPEEDS.items() if baud == self._line.baud), None)
        if speed is not None:
            settings = termios.tcgetattr(self._slave)
            settings[_ISPEED] = settings[_OSPEED] = speed
            termios.tcsetattr(self._slave, termios.TCSANOW, settings)
        os.set_blocking(self._master, False)
        if self._name is not None:
            self._name.parent.mkdir(parents=True, exist_ok=True)
            self._name.symlink_to(os.ttyname(self._slave))

    def unplug(self) -> None:
        following = os.openpty()  # before closing the old tty, to avoid reusing the number
        self.close()
        self._master, self._slave = following

    def read(self, timeout_s: float) -> bytes:
        """Bytes of the host after their transmission time."""
        until_ns = clock.now_ns() + round(timeout_s * 1e9)
        while not select.select([self._master], [], [], self._pause_s(until_ns))[0]:
            self._release()
            if clock.now_ns() >= until_ns:
                return b""
        try:
            data = os.read(self._master, 4096)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise LinkLost(str(error)) from None
        self._wait_until(clock.now_ns() + len(data) * self._character_ns)
        far = self._far_line()
        return heard(data, far, self._line) if far else data

    def set_out(self, at_ns: int) -> None:
        self._set_out_ns = at_ns

    def write(self, data: bytes) -> None:
        """Send character by character and return when the line is free. Unread data is lost."""
        if far := self._far_line():
            data = heard(data, self._line, far)
        begin_ns, self._set_out_ns = self._set_out_ns, None
        self.free_ns = max(self.free_ns, clock.now_ns() if begin_ns is None else begin_ns)
        if not self._character_ns:
            self._adapter.add(data, self.free_ns)
            self._release()
            return
        sent = 0
        while sent < len(data):
            self.free_ns += self._character_ns
            self._wait_until(self.free_ns)
            # After a late wake-up all due characters are sent, as by a UART.
            late = max(0, clock.now_ns() - self.free_ns) // self._character_ns
            due = min(1 + late, len(data) - sent)
            self.free_ns += (due - 1) * self._character_ns
            self._adapter.add(data[sent : sent + due], self.free_ns)
            self._release()
            sent += due

    def set_dtr(self, on: bool) -> None:
        """Ignored: a pty has no modem lines."""

    def _far_line(self) -> Line | None:
        baud = _SPEEDS.get(termios.tcgetattr(self._slave)[_OSPEED])
        matches = baud in (None, self._line.baud) or self._line.baud not in _SPEEDS.values()
        return None if matches else Line.model_validate(f"{baud} 8N1")

    def close(self) -> None:
        if self._name is not None:
            self._name.unlink(missing_ok=True)
        os.close(self._master)
        os.close(self._slave)

    def _wait_until(self, at_ns: int) -> None:
        while clock.now_ns() < at_ns:
            clock.sleep(self._pause_s(at_ns))
            self._release()

    def _pause_s(self, until_ns: int) -> float:
        due_ns = self._adapter.due_ns
        return max(0, (until_ns if due_ns is None else min(due_ns, until_ns)) - clock.now_ns()) / 1e9

    def _release(self) -> None:
        data = self._adapter.take(clock.now_ns())
        try:
            if data:
                os.write(self._master, data)
        except BlockingIOError:
            pass
        except OSError as error:
            raise LinkLost(str(error)) from None
