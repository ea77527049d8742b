"""An instrument that calls: it connects to the TCP port that the rig file names as ours, and again when that ends."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Callable

from daq import clock
from daq.emulators.late_link import LateLink
from daq.protocol.conversation import Conversation
from daq.wire.links import Link, LinkLost
from daq.wire.session import run_conversation

_AGAIN_S = 0.2
_CONNECT_S = 1.0
_HOST = "127.0.0.1"


class TcpCaller:
    """Calls a port of the host on loopback. `port` is what the rig file names: a port that was free."""

    @classmethod
    def open(cls, device: Callable[[], Conversation], jitter_ms: float = 0.0) -> TcpCaller:
        """Find a free port."""
        with socket.create_server((_HOST, 0)) as server:
            return cls(int(server.getsockname()[1]), device, jitter_ms)

    def __init__(self, number: int, device: Callable[[], Conversation], jitter_ms: float) -> None:
        self._number = number
        self._device = device
        self._jitter_ms = jitter_ms
        self._hang_up = clock.Event()
        self.plugged = clock.Event()
        self.plugged.set()
        self.port = f"tcp://{_HOST}:{number}"

    def serve(self, stop: clock.Event) -> None:
        """Serve until `stop` is set; when a connection ends or is refused, call again."""
        while not stop.is_set():
            if self.plugged.wait(_AGAIN_S):
                self._hang_up.clear()
                with contextlib.suppress(OSError, LinkLost):
                    self._converse(socket.create_connection((_HOST, self._number), _CONNECT_S), stop)
            stop.wait(_AGAIN_S)

    def hang_up(self) -> None:
        """End the present connection, and call again soon."""
        self._hang_up.set()

    def _converse(self, sock: socket.socket, stop: clock.Event) -> None:
        def ended() -> bool:
            return stop.is_set() or self._hang_up.is_set() or not self.plugged.is_set()

        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        sock.setblocking(False)
        with contextlib.closing(Link("emulated", sock.fileno(), sock.close)) as link:
            late = LateLink(link, self._jitter_ms) if self._jitter_ms else link
            run_conversation(late, self._device(), lambda _: None, ended)
