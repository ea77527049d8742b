"""Publishes the state of the cell ten times a second; a single client of rigd serves all browsers."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import AsyncGenerator, Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Protocol

from analysis.apps.live.daemon_source import DaemonSource
from analysis.apps.live.view import LiveView, Update
from analysis.apps.session.session_state import SessionDirectory
from analysis.apps.window import frames
from analysis.apps.window.frames import summary
from analysis.runs.tabular import for_json
from daq.service.client import Client
from rigs.errors import RigError
from rigs.text import escape_values


class Board:
    """The newest message of each kind: a slow browser skips older ones and needs no queue."""

    def __init__(self) -> None:
        self._news: dict[str, tuple[int, bytes]] = {}
        self._changed = asyncio.Event()
        self._ended = False

    def post(self, kind: str, values: Mapping[str, Any]) -> None:
        text = json.dumps(escape_values(for_json(values)), separators=(",", ":"), ensure_ascii=True, allow_nan=False)
        data = f"event: {kind}\ndata: {text}\n\n".encode()
        version, before = self._news.get(kind, (0, b""))
        if data != before:
            self._news[kind] = (version + 1, data)
            self._changed.set()
            self._changed = asyncio.Event()

    def end(self) -> None:
        """End all streams. The pages reconnect later."""
        self._ended = True
        self._changed.set()

    async def follow(self) -> AsyncGenerator[bytes, None]:
        yield b"retry: 1000\n\n"
        seen: dict[str, int] = {}
        while not self._ended:
            changed = self._changed
            news = [data for kind, (version, data) in self._news.items() if seen.get(kind) != version]
            seen = {kind: version for kind, (version, _) in self._news.items()}
            if news:
                yield b"".join(news)
            else:
                await changed.wait()


_TICK_S = 0.1
_SLOW_TICKS = 5
"""Interval in ticks for curves, trace and links: twice a second."""


class UpdateSource(Protocol):
    def begun(self) -> object: ...
    def updates(self) -> Sequence[Update]: ...
    def end(self) -> None: ...


class Watcher:
    def __init__(
        self,
        find: Callable[[], Path],
        place: SessionDirectory | None,
        source: UpdateSource | None = None,
        begin: str = "",
    ) -> None:
        """find: socket of the daemon. place: directory of the session, which the command `begin` starts."""
        self.board = Board()
        self.view = LiveView()
        self.zero_mm = (0.0, 0.0)
        self._find, self._place = find, place
        self._begin = begin
        self._source: UpdateSource = source or DaemonSource(find)
        self._session_seen: object = ...
        """State of the session file at the last check; None if the file did not exist."""

    async def run(self) -> None:
        self._source.begun()
        due_s, tick = time.monotonic(), 0
        try:
            while True:
                for update in self._source.updates():
                    self.view = self.view.after(update)
                board, view = self.board, self.view
                board.post("cell", frames.cell(view))
                board.post("now", frames.now(view, self.zero_mm, tick))
                if tick % _SLOW_TICKS == 0:
                    for kind, values in frames.curves(view).items():
                        board.post(kind, values)
                    board.post("trace", frames.trace(view))
                    board.post("links", frames.links(view))
                    self._look_at_session()
                tick += 1
                due_s = max(due_s + _TICK_S, time.monotonic() + _TICK_S / 4)
                await asyncio.sleep(due_s - time.monotonic())
        finally:
            self._source.end()

    def _look_at_session(self) -> None:
        if self._place is None:
            return
        seen: object = None
        with suppress(OSError):
            status = self._place.file.stat()
            seen = status.st_mtime_ns, status.st_size, status.st_ino
        if seen == self._session_seen:
            return
        self._session_seen = seen
        try:
            session = self._place.read()
        except RigError as error:
            self.board.post("session", {"next": {"key": "damaged", "why": str(error)}})
            return
        self.board.post("session", summary(session) if session else {"next": {"key": "none", "command": self._begin}})

    def ask(self, command: str, **fields: Any) -> dict[str, Any]:
        with Client(self._find()) as client:
            return client.ask(command, **fields)
