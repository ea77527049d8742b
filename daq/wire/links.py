"""Links: the only module that accesses serial devices and sockets.

A single `select` and `read` per piece keep the timestamp close to the arrival. A vanished TCP peer (power cut, cable,
hung program) closes nothing, so a connection that receives no data for `dead_s` counts as lost. A listening port
accepts a single sender: the first sender of data that forms a sample, until it becomes silent.
"""

from __future__ import annotations

import contextlib
import errno
import math
import os
import select
import socket
import struct
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from typing import Any

import serial

from daq import clock
from daq.protocol.conversation import Fault, FaultKind, Item
from daq.wire.serial_port import line_errors, open_serial
from rigs.errors import CellError
from rigs.schema.links import Line, ModemLines, tcp_address, udp_address

_WRITE_S = 2.0
DEAD_S = 10.0
_REPORT_EVERY_S = 1.0
_COARSE_S = 0.02
"""Minimum duration of waits that may end a millisecond late."""
WAIT_S = 0.2
"""Longest wait of `read`. It lets a stop request take effect and feeds the watchdog on a silent link."""


Address = tuple[Any, ...]
"""Host, port, and additional fields for IPv6."""


class LinkLost(Exception):
    """The peer is gone: unplugged, closed or reset."""


class Link:
    """Open byte stream in both directions. waits: the system waits for data up to `WAIT_S` in each read."""

    def __init__(
        self, name: str, fd: int, close: Callable[[], None], dead_s: float = math.inf, *, waits: bool = False
    ) -> None:
        self.name, self._waits = name, waits
        self._fd = fd
        self._close = close
        self._dead_s = dead_s
        self._heard_s = clock.now_s()

    def fileno(self) -> int:
        return self._fd

    def read(self, timeout_s: float) -> bytes:
        """Data within `timeout_s`, or `WAIT_S`; empty after a time-out. Raises LinkLost."""
        try:
            if self._waits and timeout_s >= WAIT_S:
                came = True  # each call of the system gives Python's lock to another thread, so there is only one
            elif timeout_s < _COARSE_S:
                came = bool(select.select([self._fd], [], [], max(0.0, timeout_s))[0])
            else:  # takes half the time of `select`, but waits in whole milliseconds
                came = bool(self._poll.poll(1e3 * timeout_s))
            data = os.read(self._fd, 65536) if came else None
        except BlockingIOError:
            data = None
        except (OSError, ValueError) as error:
            raise LinkLost(str(error)) from None
        if data is None:
            if clock.now_s() - self._heard_s > self._dead_s:
                raise LinkLost(f"nothing arrived for {self._dead_s:g} s; the other end may be disconnected")
            return b""
        if not data:
            raise LinkLost("the other end closed the connection")
        self._heard_s = clock.now_s()
        return data

    @cached_property
    def _poll(self) -> select.poll:
        poll = select.poll()
        poll.register(self._fd, select.POLLIN)
        return poll

    def write(self, data: bytes) -> None:
        """Send all data. Raises LinkLost, also if the line is blocked for several seconds."""
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
        """Set the modem line DTR if the port has it."""

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self._close()

    def note_items(self, items: Sequence[Item]) -> None:
        """Inform the link of the items decoded from the last data."""

    def take_ignored(self) -> list[Fault]:
        return []


class SerialLink(Link):
    def __init__(self, name: str, device: serial.Serial) -> None:
        super().__init__(name, device.fileno(), device.close)
        self._device = device
        self._errors = line_errors(self._fd)
        self._looked_s = clock.now_s()

    def take_ignored(self) -> list[Fault]:
        if clock.now_s() - self._looked_s < _REPORT_EVERY_S:
            return []
        before, self._errors, self._looked_s = self._errors, line_errors(self._fd), clock.now_s()
        increase = {name: count - before.get(name, 0) for name, count in self._errors.items()}
        errors = ", ".join(f"{count} {name}" for name, count in increase.items() if count > 0)
        if not errors:
            return []
        detail = (
            f"characters lost or damaged on the way, by the count of the port: {errors}; check the cable, the length"
        )
        count = sum(max(0, count) for count in increase.values())
        return [Fault(FaultKind.LINE, clock.now_ns(), f"{detail}, and the line settings", count)]

    def set_dtr(self, on: bool) -> None:
        try:
            self._device.dtr = on
        except OSError as error:
            if error.errno not in (errno.EINVAL, errno.ENOTTY):  # a pty has no modem lines
                raise LinkLost(str(error)) from None
        except ValueError as error:
            raise LinkLost(str(error)) from None


class UdpLink(Link):
    """UDP port with a datagram per read and write. peer: accepted sender; None until a datagram forms a sample."""

    def __init__(self, name: str, sock: socket.socket, peer: Address | None) -> None:
        super().__init__(name, sock.fileno(), sock.close)
        self._sock = sock
        self._peer_is_fixed = peer is not None
        self._peer = self._sender = peer
        self._strangers = _Strangers("datagrams")

    def read(self, timeout_s: float) -> bytes:
        try:
            if not select.select([self], [], [], max(0.0, timeout_s))[0]:
                return b""
            data, sender = self._sock.recvfrom(65536)
        except BlockingIOError:
            return b""
        except (OSError, ValueError) as error:
            raise LinkLost(str(error)) from None
        if self._peer is not None and sender != self._peer:
            self._strangers.note(sender)
            return b""
        self._sender = sender
        return data

    def write(self, data: bytes) -> None:
        if self._sender is None:
            return
        try:
            if not select.select([], [self], [], _WRITE_S)[1]:
                raise LinkLost("the network does not accept datagrams")
            self._sock.sendto(data, self._sender)
        except (OSError, ValueError) as error:
            raise LinkLost(str(error)) from None

    def note_items(self, items: Sequence[Item]) -> None:
        if self._peer_is_fixed:
            return
        for item in items:
            if not isinstance(item, Fault):
                self._peer = self._sender
            elif item.kind is FaultKind.SILENT:
                self._peer = None

    def take_ignored(self) -> list[Fault]:
        return self._strangers.report(self._peer)


class ListeningLink(Link):
    """Listening TCP port for a single program at a time.

    Another program is refused while the first delivers samples. If the first delivers none, the link is lost and
    reopened for the next program with a new conversation, because a partial line may have been received.
    """

    def __init__(self, name: str, server: socket.socket, dead_s: float) -> None:
        super().__init__(name, server.fileno(), server.close, dead_s)
        self._server = server
        self._caller: Link | None = None
        self._peer: Address | None = None
        self._makes_samples = False
        self._strangers = _Strangers("connections")

    def read(self, timeout_s: float) -> bytes:
        waited: list[socket.socket | Link] = [self._server, *([self._caller] if self._caller else [])]
        try:
            ready = select.select(waited, [], [], max(0.0, timeout_s))[0]
        except (OSError, ValueError) as error:
            raise LinkLost(str(error)) from None
        if self._server in ready and self._caller not in ready:  # data already received may prove the current caller
            self._accept()
        return self._caller.read(0.0) if self._caller else b""

    def write(self, data: bytes) -> None:
        if self._caller:
            self._caller.write(data)

    def close(self) -> None:
        if self._caller:
            self._caller.close()
        super().close()

    def note_items(self, items: Sequence[Item]) -> None:
        for item in items:
            if not isinstance(item, Fault):
                self._makes_samples = True
            elif item.kind is FaultKind.SILENT:
                self._makes_samples = False

    def take_ignored(self) -> list[Fault]:
        return self._strangers.report(self._peer)

    def _accept(self) -> None:
        try:
            sock, address = self._server.accept()
        except OSError:
            return  # the caller hung up before the answer
        if self._caller is None:
            set_up_tcp(sock, self._dead_s)
            self._caller, self._peer = Link(self.name, sock.fileno(), sock.close, self._dead_s), address
            return
        sock.close()
        if not self._makes_samples:
            old, new = _address_text(self._peer), _address_text(address)
            raise LinkLost(f"{old} sends no readable data, and {new} also connects")
        self._strangers.note(address)


class _Strangers:
    """Data from senders other than the peer, reported once a second."""

    def __init__(self, subject: str) -> None:
        self._subject = subject
        self._count = 0
        self._last: Address | None = None
        self._reported_s = -math.inf

    def note(self, address: Address) -> None:
        self._count += 1
        self._last = address

    def report(self, peer: Address | None) -> list[Fault]:
        now_s = clock.now_s()
        if not self._count or now_s - self._reported_s < _REPORT_EVERY_S:
            return []
        count, self._count, self._reported_s = self._count, 0, now_s
        stranger, read = _address_text(self._last), _address_text(peer)
        detail = f"{self._subject} from {stranger} ignored, because {read} is being read; stop the other sender"
        return [Fault(FaultKind.STRANGER, clock.now_ns(), detail, count)]


def _address_text(address: Address | None) -> str:
    return f"{address[0]}:{address[1]}" if address else "unknown"


def set_up_tcp(sock: socket.socket, dead_s: float) -> None:
    """Limit the waits of a TCP socket, send without delay, and detect a dead peer within `dead_s`."""
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    part_s = max(1, round(dead_s / 5))
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, part_s)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, part_s)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPCNT, 3)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, round(dead_s * 800))
    sock.setblocking(True)
    for option, limit_s in ((socket.SO_RCVTIMEO, WAIT_S), (socket.SO_SNDTIMEO, 0.001)):  # `write` waits by itself
        sock.setsockopt(socket.SOL_SOCKET, option, struct.pack("@ll", 0, round(1e6 * limit_s)))


_CONNECT_S = 3.0
_OURS = "give an address of this computer as configured in the controller, and a free port above 1023"
_QUEUE = 1 << 20
"""Bytes queued in datagrams for a delayed reader. The operating system may allow fewer."""


def open_link(
    name: str, port: str, line: Line, *, dead_s: float = DEAD_S, listens: bool = False, modem: ModemLines | None = None
) -> Link:
    """Open a port of the rig file. listens: the address is local. modem: None for both lines on."""
    if address := tcp_address(port):
        return _listen(name, address, dead_s) if listens else _open_tcp(name, address, dead_s)
    if address := udp_address(port):
        return _open_udp(name, address, listens=listens)
    return SerialLink(name, open_serial(name, port, line, modem))


@contextlib.contextmanager
def _reported(where: str) -> Iterator[None]:
    try:
        yield
    except UnicodeError:
        problem, remedy = "the host name is not valid", "correct the port in the rig file"
        raise CellError(where, problem, remedy, code="address.invalid") from None
    except OSError as error:
        problem = error.strerror or str(error)
        raise CellError(where, problem, "check address and network", code="port.silent") from None


def _open_udp(name: str, address: tuple[str, int], *, listens: bool) -> Link:
    where = f"{name}, udp://{address[0]}:{address[1]}"
    with _reported(where):
        family, kind, protocol, _, endpoint = socket.getaddrinfo(*address, type=socket.SOCK_DGRAM)[0]
        sock = socket.socket(family, kind, protocol)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _QUEUE)
    sock.setblocking(False)
    try:
        if listens:
            sock.bind(endpoint)
    except OSError as error:
        sock.close()
        raise CellError(where, f"cannot be bound: {error.strerror or error}", _OURS, code="port.refused") from None
    return UdpLink(name, sock, None if listens else endpoint)


def _open_tcp(name: str, address: tuple[str, int], dead_s: float) -> Link:
    where = f"{name}, tcp://{address[0]}:{address[1]}"
    with _reported(where):
        try:
            sock = socket.create_connection(address, timeout=_CONNECT_S)
        except TimeoutError:
            problem, remedy = f"no answer in {_CONNECT_S:.0f} s", "check address, cable and firewall"
            raise CellError(where, problem, remedy, code="port.silent") from None
        except ConnectionRefusedError:
            remedy = "start the service there, or correct the port number"
            raise CellError(where, "connection refused", remedy, code="port.refused") from None
    set_up_tcp(sock, dead_s)
    return Link(name, sock.fileno(), sock.close, dead_s, waits=True)


def _listen(name: str, address: tuple[str, int], dead_s: float) -> Link:
    where = f"{name}, tcp://{address[0]}:{address[1]}"
    with _reported(where):
        family, *_, endpoint = socket.getaddrinfo(*address, type=socket.SOCK_STREAM)[0]
    try:
        server = socket.create_server(endpoint[:2], family=family, backlog=1)
    except OSError as error:  # with the plain message of the system, stripped of additions by Python
        why = os.strerror(error.errno) if error.errno else str(error)
        raise CellError(where, f"cannot listen: {why}", _OURS, code="port.refused") from None
    server.setblocking(False)
    return ListeningLink(name, server, dead_s)
