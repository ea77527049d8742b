"""Entry point of `rig window`: data sources, socket, and shutdown."""

from __future__ import annotations

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

import uvicorn
from starlette.types import ASGIApp

from analysis.apps.session.session_state import SessionDirectory
from analysis.apps.window.app import Window, app_of
from analysis.apps.window.control_posts import WindowControls
from analysis.apps.window.guard import Gate, is_loopback, token_of
from analysis.apps.window.made import OutputStore
from analysis.apps.window.shelf import Shelf
from analysis.apps.window.watcher import Watcher
from daq.service.client import find_socket
from rigs.errors import CellError, UseError
from rigs.load import find, load


def listening(address: str, port: int) -> socket.socket:
    try:
        return socket.create_server((address, port), family=socket.AF_INET6 if ":" in address else socket.AF_INET)
    except (OSError, OverflowError) as error:
        problem = f"cannot be used for listening: {getattr(error, 'strerror', None) or error}"
        remedy = "choose a different --port, or end the program that has it"
        raise CellError(f"{address}:{port}", problem, remedy, code="port.in_use") from None


class WindowServer(uvicorn.Server):
    def __init__(self, app: ASGIApp, ends: Callable[[], None]) -> None:
        logging.getLogger("uvicorn.error").setLevel(logging.ERROR)  # warnings are about requests of others
        config = uvicorn.Config(
            app, lifespan="on", log_config=None, access_log=False, server_header=False, timeout_graceful_shutdown=1
        )
        super().__init__(config)
        self._ends = ends

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        self._ends()
        await super().shutdown(sockets)


@dataclass(frozen=True)
class WindowOptions:
    rig_file: str | None
    port: int
    listen: str
    token: Path | None
    names: tuple[str, ...]
    control: bool
    runs: Path | None
    session: Path | None


def run_window(asked: WindowOptions, say: Callable[[str], object]) -> None:
    """Print the address, and serve until SIGINT or SIGTERM."""
    listen, rig_file = asked.listen, asked.rig_file
    if not is_loopback(listen) and asked.token is None:
        problem = f"{listen} is accessible from other computers"
        remedy = "add --token FILE, or use an authenticating proxy in front of 127.0.0.1"
        raise UseError("--listen", problem, remedy, code="request.invalid")
    if wild := next((name for name in asked.names if "*" in name), ""):
        raise UseError("--name", f"{wild!r} is not a host name", "give the name in the address", code="address.invalid")
    host = f"[{listen}]" if ":" in listen else listen
    gate = Gate((host, *asked.names), token_of(asked.token) if asked.token else None)
    if asked.session and rig_file is None:
        raise UseError("--session", "needs the rig file of the cell", "give CELL", code="usage")
    rig = load(rig_file)[0] if rig_file is not None else None
    place = SessionDirectory(asked.session or Path(f"session-{rig.name}")) if rig else None
    shelf = Shelf(asked.runs or (place.runs if place and place.file.exists() else Path("runs")))
    sock = listening(listen, asked.port)
    # exit normally, which cleans up temporary files and processes
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    with ExitStack() as ends:
        made = OutputStore(Path(ends.enter_context(tempfile.TemporaryDirectory(prefix="rig-window-"))))
        begin, file = (place.command(rig_file), str(find(rig_file).resolve())) if place and rig_file else ("", "")
        daemon = partial(find_socket, rig.name if rig else None)
        watcher = Watcher(daemon, place, begin=begin)
        controls = WindowControls(watcher, place, file, shelf.directory) if asked.control else None
        if controls:
            ends.callback(controls.close)
        ends.callback(signal.signal, signal.SIGINT, signal.SIG_IGN)
        say(f"http://{host}:{sock.getsockname()[1]}{' with control' if controls else ''}; stop with Ctrl-C")
        remark = "" if shelf.directory.is_dir() else ", which is missing yet"
        cell = rig.name if rig else "the only cell served by rigd"
        say(f"showing {cell}, and the runs in {shelf.directory}{remark}")
        server = WindowServer(app_of(Window(watcher, shelf, place, made, gate, controls)), watcher.board.end)
        with suppress(KeyboardInterrupt):  # Ctrl-C is the normal way to stop
            server.run(sockets=[sock])
