"""Links: the only place that touches a serial device or a socket.

Every link is a file descriptor with a name, read with a time limit and stamped by whoever reads it.
pyserial opens and configures serial devices (and locks them); reading goes straight to the descriptor,
since one `select` and one `read` a piece is what keeps the stamps close to the arrival.
"""

from __future__ import annotations

import errno
import os
import select
import socket
import termios
from collections.abc import Callable
from pathlib import Path

import serial

from rigs.errors import CellError
from rigs.links import Line, tcp_address

_CONNECT_S = 3.0
_WRITE_S = 2.0
_BITS = {7: serial.SEVENBITS, 8: serial.EIGHTBITS}


class LinkLost(Exception):
    """The other end is gone: unplugged, closed or reset."""


class Link:
    """An open byte stream in both directions."""

    def __init__(self, name: str, fd: int, close: Callable[[], None]) -> None:
        self.name = name
        self._fd = fd
        self._close = close

    def read(self, timeout_s: float) -> bytes:
        """What has come, waiting at most `timeout_s` for it; empty when nothing came. Raises LinkLost."""
        try:
            if not select.select([self._fd], [], [], max(0.0, timeout_s))[0]:
                return b""
            data = os.read(self._fd, 65536)
        except BlockingIOError:
            return b""
        except (OSError, ValueError) as error:
            raise LinkLost(str(error)) from None
        if not data:
            raise LinkLost("the other end closed the connection")
        return data

    def write(self, data: bytes) -> None:
        """Send all of it. Raises LinkLost, also where nobody takes it for some seconds."""
        try:
            while data:
                if not select.select([], [self._fd], [], _WRITE_S)[1]:
                    raise LinkLost("the line takes no bytes")
                data = data[os.write(self._fd, data) :]
        except (OSError, ValueError) as error:
            raise LinkLost(str(error)) from None

    def close(self) -> None:
        """Let go of the device; safe to call twice."""
        self._close()


def open_link(name: str, port: str, line: Line) -> Link:
    """Open the port of a rig file; `name` says whose it is. Raises CellError with the remedy."""
    address = tcp_address(port)
    return _open_tcp(name, address) if address else _open_serial(name, port, line)


def _open_tcp(name: str, address: tuple[str, int]) -> Link:
    where = f"{name}, tcp://{address[0]}:{address[1]}"
    try:
        sock = socket.create_connection(address, timeout=_CONNECT_S)
    except TimeoutError:
        raise CellError(where, f"no answer in {_CONNECT_S:.0f} s", "check address, cable and firewall") from None
    except ConnectionRefusedError:
        raise CellError(where, "connection refused", "start the service there, or correct the port number") from None
    except UnicodeError:
        raise CellError(where, "no host can have this name", "correct the port") from None
    except OSError as error:
        raise CellError(where, error.strerror or str(error), "check address and network") from None
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    sock.setblocking(False)
    return Link(name, sock.fileno(), sock.close)


def _open_serial(name: str, port: str, line: Line) -> Link:
    where = f"{name}, {port}"
    if not Path(port).exists():
        raise CellError(where, "no such port", f"plug it in, or correct the port; ports here: {_ports()}")
    try:
        device = _configured(port, line)
    except serial.SerialException as error:
        raise CellError(where, *_serial_trouble(error)) from None
    except (OSError, ValueError, termios.error) as error:
        raise CellError(where, f"no serial device ({error})", "give the path of a serial port") from None
    return Link(name, device.fileno(), device.close)


def _configured(port: str, line: Line) -> serial.Serial:
    try:
        return serial.Serial(
            port,
            baudrate=line.baud,
            bytesize=_BITS[line.bits],
            parity=line.parity,
            stopbits=line.stop,
            timeout=0,
            exclusive=True,
        )
    except termios.error as error:
        if error.args[0] != errno.EINVAL:
            raise
        # A port without a line (a pty, some adapters) takes no parity; its bytes come as they are.
        return serial.Serial(port, baudrate=line.baud, timeout=0, exclusive=True)


def _serial_trouble(error: serial.SerialException) -> tuple[str, str]:
    text = str(error)
    if "exclusively lock" in text or "busy" in text:
        return "in use by another program", "stop the other program (another rigd, a terminal)"
    if "Permission denied" in text:
        return "permission denied", "add the user to the group dialout and log in again"
    return f"cannot be opened as a serial port ({error.strerror or text})", "give the path of a serial port"


def _ports() -> str:
    by_id = Path("/dev/serial/by-id")
    names = sorted(map(str, by_id.iterdir())) if by_id.is_dir() else []
    names = names or sorted(str(path) for kind in ("ttyUSB*", "ttyACM*") for path in Path("/dev").glob(kind))
    return ", ".join(names) or "none"
