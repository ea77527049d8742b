"""A web window served by this process, and requests as sent by browsers and by hostile peers."""

from __future__ import annotations

import http.client
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

from analysis.apps.live.played_run import RunPlayer, played_run
from analysis.apps.live.view import Update
from analysis.apps.session.session_state import SessionDirectory
from analysis.apps.window.app import Window, app_of
from analysis.apps.window.control_posts import WindowControls
from analysis.apps.window.guard import Gate
from analysis.apps.window.made import OutputStore
from analysis.apps.window.serve import WindowServer, listening
from analysis.apps.window.shelf import Shelf
from analysis.apps.window.watcher import Watcher
from rigs.errors import CellError

PATIENCE_S = 300.0
"""Time limit for a page, for a share of a twentieth of a busy computer. It is shorter than the time limit of a test,
so the last answer is shown.
"""


def no_daemon() -> Path:
    raise CellError("rigd", "no daemon is visible to this user", "start it: rigd RIG")


class Playing:
    """Live source that replays a recorded run, starting with the first access."""

    def __init__(self, run: Path, speed: float) -> None:
        self._run, self._speed = run, speed

    def begun(self) -> Playing:
        played = played_run(self._run, self._speed)
        self._begin = [Update(cell=played.cell, label=(played.name, played.test, played.direction))]
        self._player = RunPlayer([played])
        return self

    def updates(self) -> list[Update]:
        begin, self._begin = self._begin, []
        return [*begin, *self._player.updates()]

    def end(self) -> None:
        pass


@dataclass(frozen=True)
class Answer:
    """Response to a request."""

    status: int
    headers: dict[str, str]
    data: bytes

    @property
    def text(self) -> str:
        return self.data.decode("utf-8", "replace")


@dataclass
class Served:
    """A running window at a local port."""

    window: Window
    port: int

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def ask(self, path: str, method: str = "GET", body: str | bytes | None = None, **headers: str) -> Answer:
        """Send a request. headers: by name, with _ for -."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE_S)
        try:
            named = {name.replace("_", "-"): value for name, value in headers.items()}
            connection.request(method, path, body, named)
            answer = connection.getresponse()
            named = {name.lower(): value for name, value in answer.getheaders()}
            return Answer(answer.status, named, answer.read())
        finally:
            connection.close()

    def post(self, path: str, body: str | bytes = "", **headers: str) -> Answer:
        """Send a form as a page of the window does."""
        return self.ask(path, "POST", body, **headers)

    def until(self, path: str, is_so: Callable[[Answer], object]) -> Answer:
        """Repeat a request until the answer fulfils a condition, like a page that is being prepared."""
        end_s = time.monotonic() + PATIENCE_S
        while not is_so(answer := self.ask(path)):
            assert time.monotonic() < end_s, answer
            time.sleep(0.1)
        return answer

    def raw(self, data: bytes = b"") -> socket.socket:
        """A connection on which data have been sent."""
        sock = socket.create_connection(("127.0.0.1", self.port), timeout=PATIENCE_S)
        sock.sendall(data)
        return sock


@contextmanager
def served(
    folder: Path,
    *,
    find: Callable[[], Path] = no_daemon,
    source: Any = None,
    token: str | None = None,
    control: bool = False,
    session: Path | None = None,
    port: int = 0,
) -> Iterator[Served]:
    """Serve a window for the runs in `folder/runs`. source: live source instead of a daemon.

    Background work has the same priority as the tests; with a lower one it would starve on a busy computer.
    """
    place = SessionDirectory(session) if session else None
    watcher = Watcher(find, place, source=source, begin=place.command("cell.yaml") if place else "")
    controls = WindowControls(watcher, place, "", folder / "runs") if control else None
    window = Window(
        watcher, Shelf(folder / "runs"), place, OutputStore(folder / "made"), Gate(("Cell.Plant",), token), controls
    )
    sock = listening("127.0.0.1", port)
    server = WindowServer(app_of(window), watcher.board.end)
    thread = threading.Thread(target=server.run, kwargs={"sockets": [sock]}, daemon=True)
    thread.start()
    try:
        while not server.started:
            time.sleep(0.01)
        with patch("analysis.apps.window.made._NICE", 0):
            yield Served(window, sock.getsockname()[1])
    finally:
        server.should_exit = True
        thread.join(30)
        if controls is not None:
            controls.close()


def told(data: str, kind: str) -> list[str]:
    """Data of all events of a kind in an event stream."""
    events = (block.split("\n") for block in data.split("\n\n"))
    return [lines[1].removeprefix("data: ") for lines in events if lines[0] == f"event: {kind}" and len(lines) > 1]
