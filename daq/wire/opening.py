"""Opening what a rig file calls a port: a serial device, or an address of the network, the instrument's or our own.

pyserial opens and configures serial devices, and locks them (`daq.wire.serial_port`). Nothing listens unless the rig
file says so, and then at the address that it names and nowhere else.
"""

from __future__ import annotations

import os
import socket

from daq.wire.links import DEAD_S, Link, ListeningLink, SerialLink, UdpLink, set_up_tcp
from daq.wire.serial_port import open_serial
from rigs.errors import CellError
from rigs.schema.links import Line, ModemLines, tcp_address, udp_address

_CONNECT_S = 3.0
_OURS = (
    "give an address of this computer, to which the controller sends, and a port above 1023 that no other program uses"
)
_QUEUE = 1 << 20
"""Bytes of datagrams that may wait for a reader held up; the system may allow fewer."""


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

    dead_s: when a TCP connection that brings nothing is lost. listens: the address is ours, and not the other end's.
    modem: the modem lines of a serial port, None for both on. Raises CellError with the remedy.
    """
    if address := tcp_address(port):
        return _listen(name, address, dead_s) if listens else _open_tcp(name, address, dead_s)
    if address := udp_address(port):
        return _open_udp(name, address, listens=listens)
    return SerialLink(name, open_serial(name, port, line, modem))


def _open_udp(name: str, address: tuple[str, int], *, listens: bool) -> Link:
    where = f"{name}, udp://{address[0]}:{address[1]}"
    try:
        family, kind, protocol, _, endpoint = socket.getaddrinfo(*address, type=socket.SOCK_DGRAM)[0]
        sock = socket.socket(family, kind, protocol)
    except UnicodeError:
        raise CellError(where, "the host name is not valid", "correct the port in the rig file") from None
    except OSError as error:
        raise CellError(where, error.strerror or str(error), "check address and network") from None
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _QUEUE)
    sock.setblocking(False)
    try:
        if listens:
            sock.bind(endpoint)
    except OSError as error:
        sock.close()
        raise CellError(where, f"cannot be bound: {error.strerror or error}", _OURS) from None
    return UdpLink(name, sock, None if listens else endpoint)


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
    set_up_tcp(sock, dead_s)
    return Link(name, sock.fileno(), sock.close, dead_s)


def _listen(name: str, address: tuple[str, int], dead_s: float) -> Link:
    where = f"{name}, tcp://{address[0]}:{address[1]}"
    try:
        family, *_, endpoint = socket.getaddrinfo(*address, type=socket.SOCK_STREAM)[0]
        server = socket.create_server(endpoint[:2], family=family, backlog=1)
    except UnicodeError:
        raise CellError(where, "the host name is not valid", "correct the port in the rig file") from None
    except OSError as error:
        # Without what Python adds to the words of the system; a name that is not known has a negative number.
        why = os.strerror(error.errno) if error.errno and error.errno > 0 else error.strerror or str(error)
        raise CellError(where, f"cannot listen: {why}", _OURS) from None
    server.setblocking(False)
    return ListeningLink(name, server, dead_s)
