"""The door before Foxglove's server, which itself lets in every program: the window's gate looks at each request first.

A browser sends the origin of the page that opens a WebSocket, and no page may read the cell but Foxglove's own and
those of the names of the window. Where the window needs a token, it stands in the address: `ws://127.0.0.1:8765/?token=…`,
since Foxglove sends no header. The server itself listens at an address of this computer that cannot be guessed.
"""

from __future__ import annotations

import asyncio
import secrets
import threading
from contextlib import suppress
from urllib.parse import parse_qs, urlsplit

from analysis.window.guard import Gate

_APPS = ("https://app.foxglove.dev", "file://")
"""Origins of Foxglove in a browser and on a desktop."""
_MOST_HEAD, _HEAD_S, _MOST = 8192, 5.0, 16
"""Bytes of a request's head, seconds for it, and connections: a person has one or two."""
_PIECE = 1 << 16


def hidden_address() -> str:
    """Return an address of this computer, 127.x.y.z, that no page can find by trying: there are 16 million, each with
    60 000 ports."""
    return "127." + ".".join(str(1 + secrets.randbelow(254)) for _ in range(3))


class Door:
    """Listens in a thread of its own until it is closed, and lets through what a gate allows."""

    def __init__(self, port: int, inner: tuple[str, int], gate: Gate) -> None:
        """inner: address and port of the server behind it."""
        self.port = port
        self._inner, self._gate, self._open = inner, gate, 0
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="foxglove door", daemon=True)
        self._server: asyncio.Server

    @classmethod
    def opened(cls, port: int, inner: tuple[str, int], gate: Gate) -> Door:
        """Return a door that listens already. Raises OSError where the port is taken."""
        door = cls(port, inner, gate)
        door.start()
        return door

    def start(self) -> None:
        """Listen; of port 0, `port` is then the one that was free. Raises OSError where the port is taken."""
        listening = asyncio.start_server(self._come, "127.0.0.1", self.port, limit=_MOST_HEAD)
        try:
            self._server = self._loop.run_until_complete(listening)
        except BaseException:
            self._loop.close()
            raise
        self.port = int(self._server.sockets[0].getsockname()[1])
        self._thread.start()

    def close(self) -> None:
        """End it, with all connections."""
        self._loop.call_soon_threadsafe(self._end)
        self._thread.join()
        self._loop.close()

    def _end(self) -> None:
        self._server.close()
        tasks = asyncio.all_tasks(self._loop)
        for task in tasks:
            task.cancel()
        asyncio.gather(*tasks, return_exceptions=True).add_done_callback(lambda _: self._loop.stop())

    async def _come(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._open += 1
        try:
            # Cancelled when the door is closed, which asyncio would report as an error of this connection.
            with suppress(OSError, EOFError, asyncio.LimitOverrunError, TimeoutError, asyncio.CancelledError):
                head = await asyncio.wait_for(reader.readuntil(b"\r\n\r\n"), _HEAD_S)
                status = "503 Busy" if self._open > _MOST else refused(head, self._gate)
                if status:
                    writer.write(f"HTTP/1.1 {status}\r\nconnection: close\r\ncontent-length: 0\r\n\r\n".encode())
                    await writer.drain()
                else:
                    await self._through(head, reader, writer)
        finally:
            self._open -= 1
            writer.close()

    async def _through(self, head: bytes, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        inner_reader, inner_writer = await asyncio.open_connection(*self._inner)
        inner_writer.write(head)
        ways = [asyncio.create_task(_copied(reader, inner_writer)), asyncio.create_task(_copied(inner_reader, writer))]
        try:
            await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for way in ways:
                way.cancel()
            inner_writer.close()


async def _copied(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    with suppress(OSError):
        while piece := await reader.read(_PIECE):
            writer.write(piece)
            await writer.drain()


def refused(head: bytes, gate: Gate) -> str:
    """Return the status with which a request is refused by its head, empty where it is let in."""
    first, *lines = head.decode("latin-1").split("\r\n")
    named = [line.partition(":") for line in lines if line]
    headers = {name.strip().lower(): value.strip() for name, _, value in named}
    words = first.split(" ")
    try:
        host = urlsplit(f"//{headers.get('host', '')}").hostname or ""
        origin, asked = urlsplit(headers.get("origin", "")), urlsplit(words[1] if len(words) > 1 else "")
    except ValueError:
        return "400 Bad Request"
    if host.lower() not in gate.names:
        return "421 Misdirected Request"
    if "origin" in headers and headers["origin"] not in _APPS and (origin.hostname or "").lower() not in gate.names:
        return "403 Forbidden"
    if gate.is_let_in(headers) or any(map(gate.is_token, parse_qs(asked.query).get("token", []))):
        return ""
    return "401 Unauthorized"
