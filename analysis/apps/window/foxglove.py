"""Live data over the WebSocket protocol of Foxglove: joint angles with the URDF of the arm, gauge readings and angle.

The Foxglove server accepts any client, so a gateway checks each request first. A browser sends the origin of the page
that opens a WebSocket. Only pages of Foxglove and of the window may read the cell. A required token is part of the
address (`ws://127.0.0.1:8765/?token=…`), because Foxglove sends no header. The server listens at a random local
address, and the library limits the queue of each client.
"""

from __future__ import annotations

import asyncio
import math
import secrets
import threading
import time
from contextlib import suppress
from typing import Any
from urllib.parse import parse_qs, urlsplit

import numpy as np

from analysis.apps.interchange.mcap_export import (
    DESCRIPTION,
    DESCRIPTION_TOPIC,
    JOINT_STATES,
    JOINTS_TOPIC,
    SCHEMAS,
    joint_states,
    urdf_of,
)
from analysis.apps.live.view import LiveView
from analysis.apps.window.guard import Gate
from analysis.robot.geometry.circle import link_angle
from rigs.distribution import to_install
from rigs.errors import CellError
from rigs.rig import Rig

_APPS = ("https://app.foxglove.dev", "file://")
"""Origins of Foxglove in a browser and on the desktop."""
_MOST_HEAD, _HEAD_S, _MOST = 8192, 5.0, 16
"""Limits: size of a request head in bytes, time to send it in seconds, and number of connections (a user needs two)."""
_PIECE = 1 << 16


def hidden_address() -> str:
    """Return a random local address 127.x.y.z.

    A web page cannot guess it: there are 16 million addresses with 60 000 ports each.
    """
    return "127." + ".".join(str(1 + secrets.randbelow(254)) for _ in range(3))


class Door:
    """Gateway that listens in a thread and forwards the requests permitted by a gate."""

    def __init__(self, port: int, inner: tuple[str, int], gate: Gate) -> None:
        """Create a gateway. inner: address and port of the protected server."""
        self.port = port
        self._inner, self._gate, self._open = inner, gate, 0
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="foxglove door", daemon=True)
        self._server: asyncio.Server

    @classmethod
    def opened(cls, port: int, inner: tuple[str, int], gate: Gate) -> Door:
        """Return a listening gateway. Raises OSError if the port is taken."""
        door = cls(port, inner, gate)
        door.start()
        return door

    def start(self) -> None:
        """Start listening. If `port` is 0, it is set to the assigned port. Raises OSError if the port is taken."""
        listening = asyncio.start_server(self._come, "127.0.0.1", self.port, limit=_MOST_HEAD)
        try:
            self._server = self._loop.run_until_complete(listening)
        except BaseException:
            self._loop.close()
            raise
        self.port = int(self._server.sockets[0].getsockname()[1])
        self._thread.start()

    def close(self) -> None:
        """Stop and close all connections."""
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
            # Tasks are cancelled on closing; asyncio would report this as an error of the connection.
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
    """Return the HTTP status for refusing a request head; empty if the request is permitted."""
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


_GAUGES = {
    "type": "object",
    "title": "rig.gauges",
    "properties": {name: {"type": "number"} for name in ("g1_mm", "g2_mm", "angle_deg", "phi_deg")},
}


class Foxglove:
    """Server for the data of a view."""

    def __init__(self, port: int, rig: Rig | None, gate: Gate) -> None:
        """Create a server. rig: rig with the displayed arm. gate: access control.

        Raises CellError if the library is missing or the port is taken.
        """
        try:
            import foxglove  # noqa: PLC0415 - an extra
        except ModuleNotFoundError:
            problem = "needs the Python package foxglove-sdk, which is not installed"
            raise CellError("--foxglove", problem, to_install("foxglove-sdk")) from None
        context = self._context = foxglove.Context()  # the channels live as long as the context

        def channel(topic: str, schema: dict[str, Any]) -> Any:
            named = {**schema, "title": schema["title"]}
            return foxglove.Channel(topic, schema=named, message_encoding="json", context=context)

        self._joints = channel(JOINTS_TOPIC, SCHEMAS[JOINT_STATES])
        self._gauges = channel("/gauges", _GAUGES)
        self._described = channel(DESCRIPTION_TOPIC, SCHEMAS[DESCRIPTION])
        self._urdf = urdf_of(rig) if rig else ""
        self._until_s, self._described_s = -math.inf, -math.inf
        inner = hidden_address()
        try:
            self._server = foxglove.start_server(name="rig", host=inner, port=0, context=context)
        except RuntimeError as error:
            raise CellError(f"{inner}:0", f"cannot be used for listening: {error}", "leave --foxglove out") from None
        try:
            self._door = Door.opened(port, (inner, int(self._server.port)), gate)
        except OSError as error:
            self._server.stop()
            problem = f"cannot be used for listening: {error.strerror or error}"
            raise CellError(f"127.0.0.1:{port}", problem, "choose a different port") from None

    @property
    def port(self) -> int:
        """The listening port."""
        return self._door.port

    def show(self, view: LiveView) -> None:
        """Send the new rows of a view."""
        now_s = time.monotonic()
        if self._urdf and now_s - self._described_s > 1.0:  # new clients receive the arm within a second
            self._described_s = now_s
            self._described.log({"data": self._urdf})
        cell, new = view.cell, np.flatnonzero(view.rows.t_s > self._until_s)
        if cell is None or not len(new):
            return
        self._until_s = float(view.rows.t_s[-1])
        # Times of the daemon count from the start of its computer, like the monotonic clock of this process.
        since_1970_ns = time.time_ns() - time.monotonic_ns()
        for k in new.tolist():
            at_ns = int(view.rows.t_s[k] * 1e9) + since_1970_ns
            g1, g2 = view.rows.g_mm[k]
            degrees = float(np.degrees(link_angle(g1, g2, cell.baseline_mm))) if cell.has_angle else math.nan
            values = {"g1_mm": g1, "g2_mm": g2, "angle_deg": degrees, "phi_deg": math.degrees(view.phi[k])}
            finite = {name: float(value) for name, value in values.items() if math.isfinite(value)}
            self._gauges.log(finite, log_time=at_ns)
            message = joint_states(cell.axes, np.degrees(view.rows.q[k]).tolist(), at_ns)
            if message["joints"]:
                self._joints.log(message, log_time=at_ns)

    def close(self) -> None:
        """Close the server."""
        self._door.close()
        for channel in (self._joints, self._gauges, self._described):
            channel.close()
        self._server.stop()
