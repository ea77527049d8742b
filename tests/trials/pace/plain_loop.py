"""What `pace` holds rigd against: the loop that anyone would write, a thread for each instrument, and nothing stored.

    plain_loop.py RIG OUT

pyserial for the gauges that stream, pymodbus for those on Modbus TCP, a socket for RTDE. Each reading is stamped right
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
from pymodbus.client import ModbusTcpClient


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


def poll_gauge(port: str, rows: list[tuple[float, ...]]) -> None:
    """A gauge on Modbus TCP, read as often as it answers."""
    host, number = _address(port)
    client = ModbusTcpClient(host, port=number)
    client.connect()
    while True:
        answer = client.read_input_registers(200, count=2, device_id=1)
        value = client.convert_from_registers(answer.registers, client.DATATYPE.FLOAT32)
        rows.append((time.monotonic_ns(), value))


def stream_robot(port: str, rows: list[tuple[float, ...]]) -> None:
    """RTDE at 500 Hz: the handshake, then six angles and the controller's clock in each packet."""
    connection = socket.create_connection(_address(port))
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


def _address(port: str) -> tuple[str, int]:
    host, number = port.removeprefix("tcp://").split(":")
    return host, int(number)


def main(rig: Path, out: Path) -> None:
    """Read until a line of input."""
    data = yaml.safe_load(rig.read_text())
    ports = {"g1": data["gauges"]["g1"]["port"], "g2": data["gauges"]["g2"]["port"], "robot": data["feedback"]["port"]}
    rows: dict[str, list[tuple[float, ...]]] = {name: [] for name in ports}
    for name, port in ports.items():
        gauge = poll_gauge if port.startswith("tcp://") else stream_gauge
        read = stream_robot if name == "robot" else gauge
        threading.Thread(target=read, args=(port, rows[name]), daemon=True).start()
    print("reading", flush=True)
    sys.stdin.readline()
    np.savez(out, **{name: np.array(of) for name, of in rows.items()})
    print("kept", flush=True)


if __name__ == "__main__":
    typer.run(main)
