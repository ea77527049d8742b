"""The newest of each kind of news, and the stream by which a browser follows it (server-sent events).

There is no queue: a browser that takes its time gets the newest of each kind when it is ready, and costs no memory and
no other browser anything. What is sent is encoded once for all.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncGenerator, Mapping
from contextlib import aclosing, suppress
from typing import Any

from starlette.types import Receive, Scope, Send

from analysis.frames import for_json
from rigs.text import plain_values

MOST_VIEWERS = 50
"""Pages that follow at once. Chosen: five times as many as a cell with ten viewers."""


class Board:
    """What is known, by kind."""

    def __init__(self) -> None:
        self._news: dict[str, tuple[int, bytes]] = {}
        self._changed = asyncio.Event()
        self.viewers = 0
        self._ended = False

    def post(self, kind: str, values: Mapping[str, Any]) -> None:
        """Put something up in place of the last of its kind; what is the same is no news."""
        text = json.dumps(plain_values(for_json(values)), separators=(",", ":"), ensure_ascii=True, allow_nan=False)
        data = f"event: {kind}\ndata: {text}\n\n".encode()
        version, before = self._news.get(kind, (0, b""))
        if data != before:
            self._news[kind] = (version + 1, data)
            self._changed.set()
            self._changed = asyncio.Event()

    def end(self) -> None:
        """End what follows: the window goes, and pages ask again until there is another."""
        self._ended = True
        self._changed.set()

    async def follow(self) -> AsyncGenerator[bytes, None]:
        """Yield what is up, then what is new as often as it is asked for."""
        seen: dict[str, int] = {}
        while not self._ended:
            changed = self._changed
            news = [data for kind, (version, data) in self._news.items() if seen.get(kind) != version]
            seen = {kind: version for kind, (version, _) in self._news.items()}
            if news:
                yield b"".join(news)
            else:
                await changed.wait()


class Follow:
    """The answer to one browser that follows a board, until it goes."""

    def __init__(self, board: Board, headers: Mapping[str, str] | None = None) -> None:
        self._board, self._headers = board, dict(headers or {})

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send the stream. What holds the connection drops a reader that takes nothing (`analysis.window.run`)."""
        headers = {"content-type": "text/event-stream", "cache-control": "no-store", "x-accel-buffering": "no"}
        head = [(name.encode(), value.encode()) for name, value in {**headers, **self._headers}.items()]
        self._board.viewers += 1
        gone = asyncio.create_task(_gone(receive))
        sends = asyncio.create_task(self._send(send, head))
        try:
            await asyncio.wait((gone, sends), return_when=asyncio.FIRST_COMPLETED)
        finally:
            self._board.viewers -= 1
            for task in (gone, sends):
                task.cancel()
            with suppress(asyncio.CancelledError, OSError):
                await sends

    async def _send(self, send: Send, head: list[tuple[bytes, bytes]]) -> None:
        await send({"type": "http.response.start", "status": 200, "headers": head})
        await send({"type": "http.response.body", "body": b"retry: 1000\n\n", "more_body": True})
        async with aclosing(self._board.follow()) as news:
            async for data in news:
                await send({"type": "http.response.body", "body": data, "more_body": True})


async def _gone(receive: Receive) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass
