"""The instrument's end of a serial line on a pty.

A pty passes bytes at once, whatever baud it is set to. A real line takes one character time for each, and
that decides the stamps; so the delay is added here, a character at a time, on an absolute schedule. An FTDI adapter at
the host's end holds them longer still: its latency timer is here as well, 0 for an adapter that has none. A pty keeps
the baud that its far end was set to, though not data bits and parity: at another baud than the line's, both ends hear
nonsense.

An adapter that is unplugged takes its tty with it and comes back on another; what stays is its name under
`/dev/serial/by-id`. So a line may be given such a name: a symbolic link that goes and comes with the tty.

Characters that were sent at another baud become what a UART makes of them, which is why wrong line settings look as
they do.

At an FTDI adapter bytes wait until its latency timer runs out, or until a USB packet is full. The chip sends what has
come once every `latency_ms` (16 unless set), counted from when it last sent; with nothing to send it sends a packet of
status alone, so the timer runs on. A packet carries 62 bytes beside its two of status, and goes at once when it is full
(FTDI application note AN232B-04).

Of a network that delivers late each piece waits a random time, and none overtakes another.
"""

from __future__ import annotations

import os
import random
import select
import termios
import tty
from collections import deque
from collections.abc import Iterator
from pathlib import Path

from daq import clock
from daq.wire.conversation_loop import ByteLink
from daq.wire.links import LinkLost
from rigs.schema.links import Line

_LOOKS = 16
"""A bit time: how often a UART looks for the edge that begins a character."""


def heard(data: bytes, sent: Line, at: Line) -> bytes:
    """Return characters sent with one line's settings as the other end receives them with its own.

    Parity is not checked, and a character without its stop bit is passed on, as most drivers do.
    """
    return b"".join(bytes(_characters(character, sent, at)) for character in data)


def _characters(character: int, line: Line, at: Line) -> Iterator[int]:
    """Characters that a receiver finds, sampling each bit in its middle; the wire is idle afterwards."""
    # The wire during the one that is sent, a bit time each: start, data with the lowest bit first, parity, stop
    data = [character >> n & 1 for n in range(line.bits)]
    parity = {"N": [], "E": [sum(data) % 2], "O": [1 - sum(data) % 2]}[line.parity]
    levels = [0, *data, *parity, *[1] * line.stop]

    def level(bits: float) -> int:
        """Return the level of the line at a time in the receiver's bit times."""
        sent = int(bits * line.baud / at.baud)
        return levels[sent] if sent < len(levels) else 1

    now, end = 0.0, len(levels) * at.baud / line.baud
    while now < end:
        if level(now):
            now += 1 / _LOOKS
            continue
        yield sum(level(now + 1.5 + n) << n for n in range(at.bits))
        now += at.bits + 1.5
        while now < end and not level(now):  # no stop bit: a new character cannot begin before the wire is idle
            now += 1 / _LOOKS


_PACKET = 62


class LatencyTimer:
    """Holds bytes back as an FTDI adapter does; times in ns of any one clock. A latency of 0 holds nothing."""

    def __init__(self, latency_ms: float, now_ns: int) -> None:
        self._latency_ns = round(latency_ms * 1e6)
        self._sent_ns = now_ns
        self._held = bytearray()
        self._due_ns = now_ns

    @property
    def due_ns(self) -> int | None:
        """When the bytes must be taken; None if nothing is held."""
        return self._due_ns if self._held else None

    def add(self, data: bytes, now_ns: int) -> None:
        """Take bytes that came through the line."""
        if not self._held:
            self._due_ns = now_ns
            if self._latency_ns:
                periods = -(-(now_ns - self._sent_ns) // self._latency_ns)
                self._due_ns = self._sent_ns + max(1, periods) * self._latency_ns
        self._held += data
        if len(self._held) >= _PACKET:
            self._due_ns = now_ns

    def take(self, now_ns: int) -> bytes:
        """Return what the host gets now; empty before it is due."""
        if not self._held or now_ns < self._due_ns:
            return b""
        data = bytes(self._held)
        self._held.clear()
        self._sent_ns = self._due_ns
        return data


class LateLink:
    """A link whose sendings are late by `jitter_ms` on average, exponentially distributed."""

    def __init__(self, link: ByteLink, jitter_ms: float, seed: int = 0) -> None:
        self._link = link
        self._rate = 1e-6 / jitter_ms
        self._random = random.Random(seed)
        self._waiting: deque[tuple[int, bytes]] = deque()
        self._last_ns = 0

    def read(self, timeout_s: float) -> bytes:
        """Read from the link, and meanwhile send what is due. Raises LinkLost."""
        until_ns = clock.now_ns() + round(timeout_s * 1e9)
        while True:
            self._send_due()
            next_ns = min(until_ns, self._waiting[0][0]) if self._waiting else until_ns
            data = self._link.read(max(0, next_ns - clock.now_ns()) / 1e9)
            if data or clock.now_ns() >= until_ns:
                return data

    def write(self, data: bytes) -> None:
        """Take the data, which is sent when it is due. Raises LinkLost."""
        self._last_ns = max(self._last_ns, clock.now_ns() + round(self._random.expovariate(self._rate)))
        self._waiting.append((self._last_ns, data))
        self._send_due()

    def set_dtr(self, on: bool) -> None:
        """Set the line of the link. Raises LinkLost."""
        self._link.set_dtr(on)

    def _send_due(self) -> None:
        while self._waiting and self._waiting[0][0] <= clock.now_ns():
            self._link.write(self._waiting.popleft()[1])


_SPEEDS = {getattr(termios, name): int(name[1:]) for name in dir(termios) if name[0] == "B" and name[1:].isdigit()}
_ISPEED, _OSPEED = 4, 5
"""Places in what tcgetattr gives."""


class PtyLine:
    """A pty whose far end, `port`, a program opens as its serial port, by its `name` where it has one."""

    @classmethod
    def open(cls, line: Line, latency_ms: float = 0.0, name: Path | None = None, *, paced: bool = True) -> PtyLine:
        """Create the pty, plugged in. paced: not where what is sent comes at the pace of the line already, as from a
        capture."""
        made = cls(os.openpty(), line, latency_ms, name, paced)
        made.plug()
        return made

    def __init__(self, ends: tuple[int, int], line: Line, latency_ms: float, name: Path | None, paced: bool) -> None:
        """ends: descriptors of the instrument's end and of the far end."""
        self._master, self._slave = ends
        self.port = str(name or os.ttyname(self._slave))
        self._line = line
        self._adapter = LatencyTimer(latency_ms, clock.now_ns())
        self._character_ns = line.character_ns if paced else 0
        self._name = name
        self.free_ns = 0
        """When it has sent, or will have sent, all that it was given."""
        self._set_out_ns: int | None = None

    def plug(self) -> None:
        """Create the pty, under its name."""
        tty.setraw(self._slave)
        # For a program that opens the far end without settings; a baud that has no name stays unset.
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
        """Remove the tty and its name until `plug`, which creates another tty."""
        following = os.openpty()  # before the old one goes, whose number would be given again
        self.close()
        self._master, self._slave = following

    def read(self, timeout_s: float) -> bytes:
        """Return bytes from the host, once the line would have carried them all."""
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
        """Let what is written next start at this time, even if it has passed."""
        self._set_out_ns = at_ns

    def write(self, data: bytes) -> None:
        """Send character by character; return when the line is free again. What is not read is lost."""
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
            # A late wake-up sends what is due by now, as a UART would have.
            late = max(0, clock.now_ns() - self.free_ns) // self._character_ns
            due = min(1 + late, len(data) - sent)
            self.free_ns += (due - 1) * self._character_ns
            self._adapter.add(data[sent : sent + due], self.free_ns)
            self._release()
            sent += due

    def set_dtr(self, on: bool) -> None:
        """Do nothing: a pty has no modem lines."""

    def _far_line(self) -> Line | None:
        """The far end's settings where its baud is another one."""
        baud = _SPEEDS.get(termios.tcgetattr(self._slave)[_OSPEED])
        matches = baud in (None, self._line.baud) or self._line.baud not in _SPEEDS.values()
        return None if matches else Line.model_validate(f"{baud} 8N1")

    def close(self) -> None:
        """Remove the pty for good."""
        if self._name is not None:
            self._name.unlink(missing_ok=True)
        os.close(self._master)
        os.close(self._slave)

    def _wait_until(self, at_ns: int) -> None:
        """Meanwhile the adapter goes on sending."""
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
