"""The socket on which the window listens, and how long a connection may be silent, slow or in the way of others."""

from __future__ import annotations

import asyncio
import logging
import socket
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import uvicorn
from starlette.types import ASGIApp
from uvicorn.protocols.http.h11_impl import H11Protocol

from rigs.errors import CellError

MOST_CONNECTIONS = 128
"""Twice as many as pages that follow at once need; a silent one makes room for a new one."""
HEAD_S = 5.0
"""From the first byte of a request to the end of its head; on a network it takes milliseconds."""
SLOW_S = 10.0
"""A browser that takes nothing of what waits for it for so long is dropped."""
_KEPT = 1 << 16
"""Bytes that wait for a browser in the system, and as many here; a page has fewer."""
_MOST_HEAD = 16384


class Bounded(H11Protocol):
    """A connection that cannot be held open by saying nothing, too slowly, or by taking nothing."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Take a connection; of too many, the oldest that is silent goes."""
        super().connection_made(transport)
        transport.set_write_buffer_limits(_KEPT)
        self._slow: asyncio.TimerHandle | None = None
        self._head: asyncio.TimerHandle | None = self.loop.call_later(HEAD_S, transport.abort)
        self._since_s = self.loop.time()
        open_ones = [
            connection
            for connection in self.connections
            if isinstance(connection, Bounded) and not connection.transport.is_closing()
        ]
        if len(open_ones) > MOST_CONNECTIONS:
            silent = [connection for connection in open_ones if connection is not self and connection.is_silent]
            min(silent, key=lambda connection: connection._since_s, default=self).transport.abort()

    @property
    def is_silent(self) -> bool:
        """Whether no answer is under way on it."""
        return self.cycle is None or self.cycle.response_complete

    def data_received(self, data: bytes) -> None:
        """Take bytes; their head must be whole in time."""
        if self._head is None and self.is_silent:
            self._head = self.loop.call_later(HEAD_S, self.transport.abort)
        super().data_received(data)
        if not self.is_silent:
            self._stop_head()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection."""
        self._stop_head()
        self.resume_writing()
        super().connection_lost(exc)

    def on_response_complete(self) -> None:
        """Wait for the next request as long as for the first."""
        self._stop_head()
        super().on_response_complete()

    def pause_writing(self) -> None:
        """Too much waits for the browser: it has some seconds to take it."""
        super().pause_writing()
        if self._slow is None:
            self._slow = self.loop.call_later(SLOW_S, self.transport.abort)

    def resume_writing(self) -> None:
        """The browser has taken it."""
        if self._slow is not None:
            self._slow.cancel()
            self._slow = None
        super().resume_writing()

    def _stop_head(self) -> None:
        if self._head is not None:
            self._head.cancel()
            self._head = None


def listening(address: str, port: int) -> socket.socket:
    """Return a socket that listens. Raises CellError where it cannot."""
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    sock = socket.socket(family)
    try:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _KEPT)
        sock.bind((address, port))
        sock.listen(MOST_CONNECTIONS)
    except (OSError, OverflowError) as error:
        sock.close()
        problem = f"cannot be listened on: {getattr(error, 'strerror', None) or error}"
        raise CellError(f"{address}:{port}", problem, "give another --port, or end the program that has it") from None
    return sock


class Server(uvicorn.Server):
    """Serves until it is asked to end; streams, which have no end of their own, are ended first."""

    def __init__(self, config: uvicorn.Config, ends: Callable[[], None]) -> None:
        super().__init__(config)
        self._ends = ends

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """End streams, then connections."""
        self._ends()
        await super().shutdown(sockets)


def serve(app: ASGIApp, sock: socket.socket, ends: Callable[[], None]) -> None:
    """Serve until SIGINT or SIGTERM; ends: called when that has come."""
    with suppress(KeyboardInterrupt):  # Ctrl-C is how a person ends it
        server_of(app, ends).run(sockets=[sock])


def server_of(app: ASGIApp, ends: Callable[[], None]) -> Server:
    """Return what serves an application."""
    logging.getLogger("uvicorn.error").addFilter(_not_of_peers)
    options: dict[str, Any] = {
        "http": Bounded,
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
    return Server(uvicorn.Config(app, **options), ends)


def _not_of_peers(record: logging.LogRecord) -> bool:
    """Nothing that a peer can cause as often as it likes fills the log."""
    return record.levelno > logging.WARNING and "ASGI callable" not in record.getMessage()
