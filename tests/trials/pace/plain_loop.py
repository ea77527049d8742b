"""What `pace` holds rigd against: the loop that anyone would write, a thread for each instrument, and nothing stored.

    plain_loop.py RIG OUT

pyserial for the gauges, a socket for RTDE. Each reading is stamped right
after the read, decoded and kept in a list. A line of input ends it, and then OUT has what was kept.
"""

from __future__ import annotations

import math
import socket
import struct
import sys
import threading
import time
from pathlib import Path

import numpy as np
import serial
import typer
import yaml


def stream_gauge(port: str, rows: list[tuple[float, ...]]) -> None:
    """An ILD1420: three bytes a value, the top two bits of the last one are 10."""
    line = serial.Serial(port, 921600, timeout=0.2)
    line.write(b"OUTPUT RS422\n")
    waiting = b""
    while True:
        data = line.read(max(1, line.in_waiting))
        now_ns = time.monotonic_ns()
        waiting += data
        while len(waiting) >= 3:
            low, middle, high = waiting[:3]
            if high >> 6 != 2:
                waiting = waiting[1:]
                continue
            waiting = waiting[3:]
            code = (low & 0x3F) | (middle & 0x3F) << 6 | (high & 0x3F) << 12
            rows.append((now_ns, (102 / 65520 * code - 1) / 100 * 10.0))


def stream_robot(port: str, rows: list[tuple[float, ...]]) -> None:
    """RTDE at 500 Hz: the handshake, then six angles and the controller's clock in each packet."""
    host, number = port.removeprefix("tcp://").split(":")
    connection = socket.create_connection((host, int(number)))
    connection.sendall(struct.pack(">HBH", 5, ord("V"), 2))
    connection.recv(64)
    fields = b"timestamp,actual_q"
    connection.sendall(struct.pack(">HBd", 11 + len(fields), ord("O"), 500.0) + fields)
    connection.recv(64)
    connection.sendall(struct.pack(">HB", 3, ord("S")))
    waiting = b""
    while True:
        data = connection.recv(4096)
        now_ns = time.monotonic_ns()
        waiting += data
        while len(waiting) >= 3:
            size, kind = struct.unpack_from(">HB", waiting)
            if len(waiting) < size:
                break
            if kind == ord("U"):
                clock_s, *angles_rad = struct.unpack_from(">7d", waiting, 4)
                rows.append((now_ns, *map(math.degrees, angles_rad), clock_s))
            waiting = waiting[size:]


def main(rig: Path, out: Path) -> None:
    """Read until a line of input."""
    data = yaml.safe_load(rig.read_text())
    ports = {"g1": data["gauges"]["g1"]["port"], "g2": data["gauges"]["g2"]["port"], "robot": data["feedback"]["port"]}
    rows: dict[str, list[tuple[float, ...]]] = {name: [] for name in ports}
    for name, port in ports.items():
        read = stream_robot if name == "robot" else stream_gauge
        threading.Thread(target=read, args=(port, rows[name]), daemon=True).start()
    print("reading", flush=True)
    sys.stdin.readline()
    np.savez(out, **{name: np.array(of) for name, of in rows.items()})
    print("kept", flush=True)


if __name__ == "__main__":
    typer.run(main)
