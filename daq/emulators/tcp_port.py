"""The instrument's end of a TCP port: one connection after the other, each with a fresh conversation.

While it is unplugged it refuses connections, and comes back at the same port.
"""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Callable

from daq import clock
from daq.emulators.late_link import LateLink
from daq.protocol.conversation import Conversation
from daq.wire.links import Link, LinkLost
from daq.wire.session import run_conversation

_ACCEPT_S = 0.2


class TcpPort:
    """Listens on loopback at a free port and serves each client that connects."""

    @classmethod
    def open(cls, device: Callable[[], Conversation], jitter_ms: float = 0.0) -> TcpPort:
        """Listen at a free port."""
        return cls(socket.create_server(("127.0.0.1", 0)), device, jitter_ms)

    def __init__(self, server: socket.socket, device: Callable[[], Conversation], jitter_ms: float) -> None:
        self._device = device
        self._jitter_ms = jitter_ms
        self._hang_up = clock.Event()
        self.plugged = clock.Event()
        self.plugged.set()
        self._server = server
        self._address = self._server.getsockname()
        self.port = f"tcp://127.0.0.1:{self._address[1]}"

    def serve(self, stop: clock.Event) -> None:
        """Serve until `stop` is set; when a connection ends, the next is accepted."""
        self._accept(stop)
        while not stop.is_set():
            if self.plugged.wait(_ACCEPT_S) and self._listen():
                self._accept(stop)

    def _listen(self) -> bool:
        try:
            self._server = socket.create_server(self._address)
        except OSError:
            return False  # somebody's connection was lent the port meanwhile; soon it is free again
        return True

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

    def _converse(self, sock: socket.socket, stop: clock.Event) -> None:
        def ended() -> bool:
            return stop.is_set() or self._hang_up.is_set() or not self.plugged.is_set()

        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        sock.setblocking(False)
        link = Link("emulated", sock.fileno(), sock.close)
        late = LateLink(link, self._jitter_ms) if self._jitter_ms else link
        with contextlib.suppress(LinkLost):
            run_conversation(late, self._device(), lambda _: None, ended)
        link.close()

    def hang_up(self) -> None:
        """End the present connection; the next one is served again."""
        self._hang_up.set()
