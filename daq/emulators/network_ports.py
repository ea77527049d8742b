"""Instrument side of network ports: TCP server, TCP client and UDP. Each connection has a new conversation."""

from __future__ import annotations

import contextlib
import select
import socket
from abc import ABC, abstractmethod
from collections.abc import Callable

from daq import clock
from daq.emulators.pty_line import LateLink
from daq.protocol.conversation import Conversation
from daq.wire.conversation_loop import run_conversation
from daq.wire.links import Link, LinkLost

_ACCEPT_S = 0.2
_AGAIN_S = 0.2
_CONNECT_S = 1.0
_HOST = "127.0.0.1"


class NetworkPort(ABC):
    def __init__(self, port: str, device: Callable[[], Conversation], jitter_ms: float) -> None:
        self.port = port
        self._device = device
        self._jitter_ms = jitter_ms
        self._hang_up = clock.Event()
        self.plugged = clock.Event()
        """Cleared while the cable is unplugged."""
        self.plugged.set()

    @abstractmethod
    def serve(self, stop: clock.Event) -> None:
        """Serve until `stop` is set."""

    def hang_up(self) -> None:
        self._hang_up.set()

    def _converse(self, sock: socket.socket, stop: clock.Event) -> None:

        def ended() -> bool:
            return stop.is_set() or self._hang_up.is_set() or not self.plugged.is_set()

        if sock.type == socket.SOCK_STREAM:
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        sock.setblocking(False)
        with contextlib.closing(Link("emulated", sock.fileno(), sock.close)) as link, contextlib.suppress(LinkLost):
            late = LateLink(link, self._jitter_ms) if self._jitter_ms else link
            run_conversation(late, self._device(), lambda _: None, ended)


class TcpPort(NetworkPort):
    def __init__(
        self, device: Callable[[], Conversation], jitter_ms: float = 0.0, server: socket.socket | None = None
    ) -> None:
        self._server = server or socket.create_server((_HOST, 0))
        self._address = self._server.getsockname()
        super().__init__(f"tcp://{_HOST}:{self._address[1]}", device, jitter_ms)

    def serve(self, stop: clock.Event) -> None:
        self._accept(stop)
        while not stop.is_set():
            if not self.plugged.wait(_ACCEPT_S):
                continue
            try:
                self._server = socket.create_server(self._address)
            except OSError:
                continue  # the port was briefly assigned to an outgoing connection
            self._accept(stop)

    def _accept(self, stop: clock.Event) -> None:
        self._server.settimeout(_ACCEPT_S)
        with self._server:
            while self.plugged.is_set() and not stop.is_set():
                try:
                    sock, _ = self._server.accept()
                except TimeoutError:
                    continue
                self._hang_up.clear()
                self._converse(sock, stop)


class TcpCaller(NetworkPort):
    def __init__(self, device: Callable[[], Conversation], jitter_ms: float = 0.0) -> None:
        with socket.create_server((_HOST, 0)) as server:
            self._number = int(server.getsockname()[1])
        super().__init__(f"tcp://{_HOST}:{self._number}", device, jitter_ms)

    def serve(self, stop: clock.Event) -> None:
        while not stop.is_set():
            if self.plugged.wait(_AGAIN_S):
                self._hang_up.clear()
                with contextlib.suppress(OSError):
                    self._converse(socket.create_connection((_HOST, self._number), _CONNECT_S), stop)
            stop.wait(_AGAIN_S)


class UdpPort(NetworkPort):
    """UDP port on loopback, with a single peer.

    A controller that calls (RSI, EGM) sends unprompted to a free port of the host; another (Stream Motion) waits for
    the first datagram. If no process listens at the port of the peer, the controller program ends, and is restarted, as
    by an operator, with a new conversation and, if it calls, a new port.
    """

    def __init__(self, device: Callable[[], Conversation], *, calls: bool, jitter_ms: float = 0.0) -> None:
        self._calls = calls
        with _bound(0) as sock:
            self._number = int(sock.getsockname()[1])
        super().__init__(f"udp://{_HOST}:{self._number}", device, jitter_ms)

    def serve(self, stop: clock.Event) -> None:
        while not stop.is_set():
            if not self.plugged.wait(_AGAIN_S):
                continue
            self._hang_up.clear()
            with _bound(0 if self._calls else self._number) as sock:
                peer = (_HOST, self._number) if self._calls else None
                while peer is None and not stop.is_set():
                    came = select.select([sock], [], [], _AGAIN_S)[0]
                    peer = sock.recvfrom(1, socket.MSG_PEEK)[1] if came else None
                if peer is not None:
                    sock.connect(peer)
                    self._converse(sock, stop)
            stop.wait(_AGAIN_S)


def _bound(number: int) -> socket.socket:
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.bind((_HOST, number))
    return sock
