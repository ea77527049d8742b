"""The instruments of `pace`, in a process of their own: it notes when each message was handed to the system.

    pace_cell.py RIG OUT HZ

Two ILD1420 on ptys that stream at this rate, and a controller that streams RTDE. Every reading is its own number.
The output begins with the rig file's text with the ports of this cell. A line of input ends the sending; then OUT has
the instants of every number.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import sys
import termios
import threading
import time
import tty
from pathlib import Path

import numpy as np
import typer
import yaml

from daq import feedback
from daq.protocol.conversation import ConversationStep
from rigs.load import find, parse

SPAN = 64_000
"""Numbers that fit into the range of an ILD1420; then they begin again."""
STEP_DEG = 1e-6
_FIRST_CODE = 643
_RANGE_MM = 10.0
_MOST_PAUSE_S = 0.05
_MADE_UP_S = 0.1
"""A pty takes 9.7 kB at once (Linux 6.18), which is 0.27 s at 12 kHz."""
_MOST_PORT_S = 5.0
_PORT_BYTES = 3 * 18_000
"""What a serial port of Linux holds beyond a pty's 13.8 kB: `tty_buffer.c` lets 64 kB wait, and `n_tty.c` 4."""


def numbers_of(values_mm: np.ndarray) -> np.ndarray:
    """Numbers from the readings of a gauge in order, counted on where they begin again."""
    codes = np.round((values_mm / _RANGE_MM * 100 + 1) * 65520 / 102).astype(int) - _FIRST_CODE
    return codes[0] + np.concatenate([[0], np.cumsum(np.diff(codes) % SPAN)])


def _encoded() -> bytes:
    """All readings in a row, three bytes each, twice over: any piece of up to SPAN readings is a slice."""
    codes = np.arange(_FIRST_CODE, _FIRST_CODE + SPAN)
    parts = np.stack([tag << 6 | codes >> 6 * tag & 0x3F for tag in range(3)], axis=1)
    return 2 * parts.astype(np.uint8).tobytes()


class Streaming:
    """A gauge on a pty: message k is due k periods after the first byte that it hears.

    One that is itself kept from running for longer than it can make up for at once stands still meanwhile. What its
    reader is late for waits, as at a serial port, and is lost beyond what that holds.
    """

    def __init__(self, rate_hz: float) -> None:
        self._master, slave = os.openpty()
        tty.setraw(slave, termios.TCSANOW)
        os.set_blocking(self._master, False)
        self._slave, self.port = slave, os.ttyname(slave)
        self._rate_hz, self._start_ns, self._readings = rate_hz, 0, _encoded()
        self._waiting = bytearray()
        self.sent_ns: list[tuple[int, int]] = []

    def act(self) -> int:
        """Send what is due; return when more is."""
        now_ns = time.monotonic_ns()
        if not self._start_ns:
            if not select.select([self._master], [], [], 0)[0]:
                return now_ns + 10_000_000
            self._start_ns = now_ns
        first = len(self.sent_ns)
        due = int((now_ns - self._start_ns) * self._rate_hz / 1e9) + 1 - first
        if (beyond := due - int(_MADE_UP_S * self._rate_hz)) > 0:
            due, self._start_ns = due - beyond, self._start_ns + round(beyond * 1e9 / self._rate_hz)
        if due > 0:
            begin = 3 * (first % SPAN)
            before_ns = time.monotonic_ns()
            self._waiting += self._readings[begin : begin + 3 * due]
            self.hand_on()
            del self._waiting[_PORT_BYTES:]
            self.sent_ns += [(before_ns, time.monotonic_ns())] * due
        return self._start_ns + round(len(self.sent_ns) * 1e9 / self._rate_hz)

    def hand_on(self) -> bool:
        """Give the system what it takes of that which waits; return whether more waits."""
        with contextlib.suppress(BlockingIOError):
            del self._waiting[: os.write(self._master, self._waiting)]
        return bool(self._waiting)


class Controller:
    """RTDE by the emulated controller; its joints show the number of the packet."""

    def __init__(self) -> None:
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.setblocking(False)
        self.port = f"tcp://127.0.0.1:{self._listener.getsockname()[1]}"
        self._device = feedback.device(parse(find("ur10e-cell").read_text(), "pace").feedback, self._read)
        self._socket: socket.socket | None = None
        self._wake_ns: int | None = None
        self._count = 0
        self.sent_ns: list[tuple[int, int]] = []

    def _read(self, now_ns: int) -> list[float]:
        self._count += 1
        return [(self._count - 1) * STEP_DEG] * 6

    def act(self) -> int:
        now_ns = time.monotonic_ns()
        if self._socket is None:
            try:
                self._socket, _ = self._listener.accept()
            except BlockingIOError:
                return now_ns + 10_000_000
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._device.connected(now_ns)
        if self._wake_ns is None:
            if not select.select([self._socket], [], [], 0)[0]:
                return now_ns + 1_000_000
            self._do(self._device.received(self._socket.recv(4096), now_ns))
        elif now_ns >= self._wake_ns:
            self._do(self._device.tick(now_ns))
        return self._wake_ns or now_ns

    def _do(self, step: ConversationStep) -> None:
        self._wake_ns = step.wake_ns
        before_ns = time.monotonic_ns()
        self._socket.sendall(step.send)
        self.sent_ns += [(before_ns, time.monotonic_ns())] * (self._count - len(self.sent_ns))


def rig_text(rig: Path, ports: dict[str, str]) -> str:
    data = yaml.safe_load(rig.read_text())
    for name in ("g1", "g2"):
        data["gauges"][name]["port"] = ports[name]
    data["feedback"]["port"] = ports["robot"]
    return yaml.safe_dump(data)


def main(rig: Path, out: Path, rate_hz: float) -> None:
    """Serve the instruments until a line of input."""
    gauges = {name: Streaming(rate_hz) for name in ("g1", "g2")}
    servers = {**gauges, "robot": Controller()}
    print(rig_text(rig, {name: server.port for name, server in servers.items()}), end="\0", flush=True)
    stopped = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.readline(), stopped.set()), daemon=True).start()
    while not stopped.is_set():
        due_ns = min(server.act() for server in servers.values())
        time.sleep(min(_MOST_PAUSE_S, max(0, due_ns - time.monotonic_ns()) / 1e9))
    until_s = time.monotonic() + _MOST_PORT_S
    while any(gauge.hand_on() for gauge in gauges.values()) and time.monotonic() < until_s:
        time.sleep(0.01)
    np.savez(out, **{name: np.array(server.sent_ns) for name, server in servers.items()})
    print("sent", flush=True)
    sys.stdin.readline()  # a pty that is closed loses what nobody has read yet


if __name__ == "__main__":
    typer.run(main)
