"""Entry point of `rig window`: data sources, access control, shutdown, and a socket with limits for idle, slow and
excess connections.
"""

from __future__ import annotations

import asyncio
import logging
import signal
import socket
import sys
import tempfile
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import uvicorn
from starlette.types import ASGIApp
from uvicorn.protocols.http.h11_impl import H11Protocol

from analysis.apps.session.session_state import SessionDirectory
from analysis.apps.window.app import Window, app_of
from analysis.apps.window.control_posts import WindowControls
from analysis.apps.window.foxglove import Foxglove
from analysis.apps.window.guard import Gate, is_loopback, token_of
from analysis.apps.window.made import OutputStore
from analysis.apps.window.shelf import Shelf
from analysis.apps.window.watcher import Watcher
from daq.service.client import find_socket
from rigs.errors import CellError, UseError
from rigs.load import find, load

MOST_CONNECTIONS = 128
"""Maximum number of connections, twice the need of all viewers. A new connection replaces an idle one."""
HEAD_S = 5.0
"""Time limit for the head of a request. On a network it takes milliseconds."""
SLOW_S = 10.0
"""Time after which a browser that does not accept data is disconnected."""
_KEPT = 1 << 16
"""Size limit in bytes of the write queue and of the send buffer of the system. A page is smaller."""
_MOST_HEAD = 16384


class LimitedConnection(H11Protocol):
    """HTTP connection with limits against idle and slow clients."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Accept a connection. At the limit, close the connection that has been idle longest."""
        super().connection_made(transport)
        transport.set_write_buffer_limits(_KEPT)
        self._slow: asyncio.TimerHandle | None = None
        self._head: asyncio.TimerHandle | None = self.loop.call_later(HEAD_S, transport.abort)
        self._since_s = self.loop.time()
        open_ones = [
            connection
            for connection in self.connections
            if isinstance(connection, LimitedConnection) and not connection.transport.is_closing()
        ]
        if len(open_ones) > MOST_CONNECTIONS:
            silent = [connection for connection in open_ones if connection is not self and connection.is_silent]
            min(silent, key=lambda connection: connection._since_s, default=self).transport.abort()

    @property
    def is_silent(self) -> bool:
        """True if all requests have been answered."""
        return self.cycle is None or self.cycle.response_complete

    def data_received(self, data: bytes) -> None:
        """Receive bytes. The head of a request must be complete in time."""
        if self._head is None and self.is_silent:
            self._head = self.loop.call_later(HEAD_S, self.transport.abort)
        super().data_received(data)
        if not self.is_silent:
            self._stop_head()

    def connection_lost(self, exc: Exception | None) -> None:
        """Cancel the timers of the connection."""
        self._stop_head()
        self.resume_writing()
        super().connection_lost(exc)

    def on_response_complete(self) -> None:
        """Cancel the time limit of the head."""
        self._stop_head()
        super().on_response_complete()

    def pause_writing(self) -> None:
        """Start the time limit of a full queue."""
        super().pause_writing()
        if self._slow is None:
            self._slow = self.loop.call_later(SLOW_S, self.transport.abort)

    def resume_writing(self) -> None:
        """Cancel the time limit of the queue."""
        if self._slow is not None:
            self._slow.cancel()
            self._slow = None
        super().resume_writing()

    def _stop_head(self) -> None:
        if self._head is not None:
            self._head.cancel()
            self._head = None


def listening(address: str, port: int) -> socket.socket:
    """Return a listening socket. Raises CellError on failure."""
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    sock = socket.socket(family)
    try:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _KEPT)
        sock.bind((address, port))
        sock.listen(MOST_CONNECTIONS)
    except (OSError, OverflowError) as error:
        sock.close()
        problem = f"cannot be used for listening: {getattr(error, 'strerror', None) or error}"
        raise CellError(
            f"{address}:{port}", problem, "choose a different --port, or end the program that has it"
        ) from None
    return sock


class WindowServer(uvicorn.Server):
    """Server that ends the endless event streams before closing connections at shutdown."""

    def __init__(self, config: uvicorn.Config, ends: Callable[[], None]) -> None:
        super().__init__(config)
        self._ends = ends

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """End the streams, then close the connections."""
        self._ends()
        await super().shutdown(sockets)


def serve(app: ASGIApp, sock: socket.socket, ends: Callable[[], None]) -> None:
    """Serve until SIGINT or SIGTERM. ends: function called at that time."""
    with suppress(KeyboardInterrupt):  # Ctrl-C is the normal way to stop
        server_of(app, ends).run(sockets=[sock])


def server_of(app: ASGIApp, ends: Callable[[], None]) -> WindowServer:
    """Return the server of an application."""
    logging.getLogger("uvicorn.error").addFilter(_not_of_peers)
    options: dict[str, Any] = {
        "http": LimitedConnection,
        "ws": "none",
        "loop": "asyncio",
        "lifespan": "on",
        "log_config": None,
        "access_log": False,
        "server_header": False,
        "proxy_headers": False,
        "timeout_keep_alive": 5,
        "timeout_graceful_shutdown": 1,
        "h11_max_incomplete_event_size": _MOST_HEAD,
    }
    return WindowServer(uvicorn.Config(app, **options), ends)


def _not_of_peers(record: logging.LogRecord) -> bool:
    """Filter out log messages that a client could trigger in large numbers."""
    return record.levelno > logging.WARNING and "ASGI callable" not in record.getMessage()


@dataclass(frozen=True)
class WindowOptions:
    """Options of `rig window`."""

    rig_file: str | None
    port: int
    listen: str
    token: Path | None
    names: tuple[str, ...]
    control: bool
    foxglove: int | None
    runs: Path | None
    session: Path | None

    def gate(self) -> Gate:
        """Access control of the options.

        Raises UseError for public access without a token, and FileError for an invalid token.
        """
        if not is_loopback(self.listen) and self.token is None:
            problem = f"{self.listen} is accessible from other computers"
            remedy = "add --token FILE, or use an authenticating proxy in front of 127.0.0.1"
            raise UseError("--listen", problem, remedy)
        return Gate.of([self.listen, *self.names], token_of(self.token) if self.token else None)


def run_window(asked: WindowOptions, say: Callable[[str], object]) -> None:
    """Serve until SIGINT or SIGTERM and print the address. Raises RigError if serving is not possible."""
    gate = asked.gate()
    if asked.session and asked.rig_file is None:
        raise UseError("--session", "needs the rig file of the cell", "give CELL")
    rig = load(asked.rig_file)[0] if asked.rig_file is not None else None
    place = SessionDirectory(asked.session or Path(f"session-{rig.name}")) if rig else None
    shelf = Shelf(asked.runs or (place.runs if place and place.file.exists() else Path("runs")))
    sock = listening(asked.listen, asked.port)
    # exit normally, which cleans up temporary files and processes
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    with ExitStack() as ends:
        made = OutputStore(Path(ends.enter_context(tempfile.TemporaryDirectory(prefix="rig-window-"))))
        stream = None
        if asked.foxglove is not None:
            stream = Foxglove(asked.foxglove, rig, gate)
            ends.callback(stream.close)
            open_to = "" if gate.token else "; web pages of other programs on this computer can also read the data"
            say(f"ws://127.0.0.1:{stream.port}{'/?token=TOKEN' if gate.token else ''} for Foxglove{open_to}")
        begin = place.command(asked.rig_file) if place and asked.rig_file else ""
        daemon = partial(find_socket, rig.name if rig else None)
        watcher = Watcher(daemon, place, stream.show if stream else None, begin=begin)
        controls = None
        if asked.control:
            session_rig = str(find(asked.rig_file).resolve()) if asked.rig_file else ""
            controls = WindowControls(watcher, place, session_rig, shelf.directory)
            ends.callback(controls.close)
        ends.callback(signal.signal, signal.SIGINT, signal.SIG_IGN)
        where = f"[{asked.listen}]" if ":" in asked.listen else asked.listen
        say(f"http://{where}:{sock.getsockname()[1]}{' with control' if controls else ''}; stop with Ctrl-C")
        remark = "" if shelf.directory.is_dir() else ", which is missing yet"
        cell = rig.name if rig else "the only cell served by rigd"
        say(f"showing {cell}, and the runs in {shelf.directory}{remark}")
        serve(app_of(Window(watcher, shelf, place, made, gate, controls)), sock, watcher.board.end)
