"""Links: the only place that touches a serial device or a socket.

Every link is a file descriptor with a name, read with a time limit and stamped by its reader.

A TCP peer that vanishes (power cut, cable, a program that hangs) closes nothing: a connection that brings nothing
for `dead_s` is lost. The system notices a computer that is gone somewhat earlier, and reports it in its own words.

UDP has no connections at all. A port is bound where the rig file names one and nowhere else; the sender of what made
a sample is the peer until it is silent, and only that peer is answered and read (`UdpLink`).

pyserial opens and configures serial devices, and locks them (`daq.wire.serial_port`); reading goes straight to the
descriptor, since one `select` and one `read` a piece is what keeps the stamps close to the arrival.
"""

from __future__ import annotations

import contextlib
import errno
import math
import os
import select
import socket
import time
from collections.abc import Callable, Sequence
from typing import Any

import serial

from daq.protocol.conversation import Fault, FaultKind, Item
from daq.wire.serial_port import open_serial
from rigs.errors import CellError
from rigs.schema.links import Line, ModemLines, tcp_address, udp_address

_CONNECT_S = 3.0
_WRITE_S = 2.0
DEAD_S = 10.0
"""A TCP connection that brings nothing for so long is lost, unless the instrument is given more time to answer."""
_QUEUE = 1 << 20
"""Bytes of datagrams that may wait for a reader held up; the system may allow fewer."""
_REPORT_EVERY_S = 1.0


Address = tuple[Any, ...]
"""The address of a UDP sender as the system gives it: host, port, and more for IPv6."""


class LinkLost(Exception):
    """The other end is gone: unplugged, closed or reset."""


class Link:
    """An open byte stream in both directions."""

    def __init__(self, name: str, fd: int, close: Callable[[], None], dead_s: float = math.inf) -> None:
        self.name = name
        self._fd = fd
        self._close = close
        self._dead_s = dead_s
        self._heard_s = time.monotonic()

    def fileno(self) -> int:
        """Return the file descriptor of the link."""
        return self._fd

    def read(self, timeout_s: float) -> bytes:
        """Return what has come, waiting at most `timeout_s` for it; empty if nothing came. Raises LinkLost."""
        try:
            if not select.select([self._fd], [], [], max(0.0, timeout_s))[0]:
                self._check_alive()
                return b""
            data = os.read(self._fd, 65536)
        except BlockingIOError:
            return b""
        except (OSError, ValueError) as error:
            raise LinkLost(str(error)) from None
        if not data:
            raise LinkLost("the other end closed the connection")
        self._heard_s = time.monotonic()
        return data

    def _check_alive(self) -> None:
        if time.monotonic() - self._heard_s > self._dead_s:
            raise LinkLost(f"nothing arrived for {self._dead_s:g} s, the other end may be gone")

    def write(self, data: bytes) -> None:
        """Send all of the data. Raises LinkLost, also if the line accepts nothing for some seconds."""
        try:
            while data:
                try:
                    data = data[os.write(self._fd, data) :]
                except BlockingIOError:
                    if not select.select([], [self._fd], [], _WRITE_S)[1]:
                        raise LinkLost("the line does not accept data") from None
        except (OSError, ValueError) as error:
            raise LinkLost(str(error)) from None

    def set_dtr(self, on: bool) -> None:
        """Set the modem line DTR, on a port that has it. Raises LinkLost."""

    def close(self) -> None:
        """Close the device; this is safe to call twice, and for a device that is gone."""
        with contextlib.suppress(OSError):
            self._close()

    def note_items(self, items: Sequence[Item]) -> None:
        """Take note of what the conversation made of the data that was read last."""

    def take_ignored(self) -> list[Fault]:
        """Return, as faults, what came from other senders since the last call and was ignored."""
        return []


class SerialLink(Link):
    """A serial port."""

    def __init__(self, name: str, device: serial.Serial) -> None:
        super().__init__(name, device.fileno(), device.close)
        self._device = device

    def set_dtr(self, on: bool) -> None:
        try:
            self._device.dtr = on
        except OSError as error:
            if error.errno not in (errno.EINVAL, errno.ENOTTY):  # a pty has no modem lines
                raise LinkLost(str(error)) from None
        except ValueError as error:
            raise LinkLost(str(error)) from None


class UdpLink(Link):
    """A UDP port: a read gives one datagram, a write sends one.

    peer: the only sender that is answered and read; None for the first one whose datagram makes a sample.
    """

    def __init__(self, name: str, sock: socket.socket, peer: Address | None) -> None:
        super().__init__(name, sock.fileno(), sock.close)
        self._sock = sock
        self._peer_is_fixed = peer is not None
        self._peer = self._sender = peer
        self._strangers = 0
        self._stranger: Address | None = None
        self._reported_s = -math.inf

    def read(self, timeout_s: float) -> bytes:
        """Return the next datagram of the peer, waiting at most `timeout_s`; empty if none came. Raises LinkLost."""
        try:
            if not select.select([self], [], [], max(0.0, timeout_s))[0]:
                return b""
            data, sender = self._sock.recvfrom(65536)
        except BlockingIOError:
            return b""
        except (OSError, ValueError) as error:
            raise LinkLost(str(error)) from None
        if self._peer is not None and sender != self._peer:
            self._strangers += 1
            self._stranger = sender
            return b""
        self._sender = sender
        return data

    def write(self, data: bytes) -> None:
        """Answer the sender that was read last. Raises LinkLost."""
        if self._sender is None:
            return
        try:
            if not select.select([], [self], [], _WRITE_S)[1]:
                raise LinkLost("the network does not accept datagrams")
            self._sock.sendto(data, self._sender)
        except (OSError, ValueError) as error:
            raise LinkLost(str(error)) from None

    def note_items(self, items: Sequence[Item]) -> None:
        """A sample makes its sender the peer; after a silence anyone may be it."""
        if self._peer_is_fixed:
            return
        for item in items:
            if not isinstance(item, Fault):
                self._peer = self._sender
            elif item.kind is FaultKind.SILENT:
                self._peer = None

    def take_ignored(self) -> list[Fault]:
        now_s = time.monotonic()
        if not self._strangers or self._stranger is None or now_s - self._reported_s < _REPORT_EVERY_S:
            return []
        count, self._strangers, self._reported_s = self._strangers, 0, now_s
        stranger, peer = _address_text(self._stranger), _address_text(self._peer)
        detail = f"datagrams from {stranger} ignored, since {peer} is being read; stop the other sender"
        return [Fault(FaultKind.STRANGER, time.monotonic_ns(), detail, count)]


def _address_text(address: Address | None) -> str:
    return f"{address[0]}:{address[1]}" if address else "unknown"


def open_link(
    name: str,
    port: str,
    line: Line,
    *,
    dead_s: float = DEAD_S,
    listens: bool = False,
    modem: ModemLines | None = None,
) -> Link:
    """Open the port of a rig file; `name` is the stream that it belongs to.

    dead_s: when a TCP connection that brings nothing is lost. listens: a UDP port is ours, and not the other end's.
    modem: the modem lines of a serial port, None for both on. Raises CellError with the remedy.
    """
    if address := tcp_address(port):
        return _open_tcp(name, address, dead_s)
    if address := udp_address(port):
        return _open_udp(name, address, listens=listens)
    return SerialLink(name, open_serial(name, port, line, modem))


def _open_udp(name: str, address: tuple[str, int], *, listens: bool) -> Link:
    where = f"{name}, udp://{address[0]}:{address[1]}"
    try:
        family, kind, protocol, _, found = socket.getaddrinfo(*address, type=socket.SOCK_DGRAM)[0]
        sock = socket.socket(family, kind, protocol)
    except UnicodeError:
        raise CellError(where, "the host name is not valid", "correct the port in the rig file") from None
    except OSError as error:
        raise CellError(where, error.strerror or str(error), "check address and network") from None
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _QUEUE)
    sock.setblocking(False)
    try:
        if listens:
            sock.bind(found)
    except OSError as error:
        sock.close()
        remedy = (
            "give an address of this computer, to which the controller sends, and a port that no other program uses"
        )
        raise CellError(where, f"cannot be bound: {error.strerror or error}", remedy) from None
    return UdpLink(name, sock, None if listens else found)


def _open_tcp(name: str, address: tuple[str, int], dead_s: float) -> Link:
    where = f"{name}, tcp://{address[0]}:{address[1]}"
    try:
        sock = socket.create_connection(address, timeout=_CONNECT_S)
    except TimeoutError:
        raise CellError(where, f"no answer in {_CONNECT_S:.0f} s", "check address, cable and firewall") from None
    except ConnectionRefusedError:
        raise CellError(where, "connection refused", "start the service there, or correct the port number") from None
    except UnicodeError:
        raise CellError(where, "the host name is not valid", "correct the port in the rig file") from None
    except OSError as error:
        raise CellError(where, error.strerror or str(error), "check address and network") from None
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    _set_keepalive(sock, dead_s)
    sock.setblocking(False)
    return Link(name, sock.fileno(), sock.close, dead_s)


def _set_keepalive(sock: socket.socket, dead_s: float) -> None:
    """Let the system probe a silent peer, and give up data that is not acknowledged, before `dead_s`."""
    part_s = max(1, round(dead_s / 5))
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, part_s)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, part_s)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPCNT, 3)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, round(dead_s * 800))
