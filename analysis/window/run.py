"""A window from its command: what it shows, who may look, and its end."""

from __future__ import annotations

import signal
import sys
import tempfile
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from analysis.session.state import Place
from analysis.window.app import Window, app_of
from analysis.window.controls import Controls
from analysis.window.foxglove import Foxglove
from analysis.window.guard import Gate, is_loopback, token_of
from analysis.window.made import Made
from analysis.window.serve import listening, serve
from analysis.window.shelf import Shelf
from analysis.window.watcher import Watcher
from daq.service.client import find_socket
from rigs.errors import UseError
from rigs.load import find, load


@dataclass(frozen=True)
class Asked:
    """What a person asks for, as the options of `rig window`."""

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
        """Return who may look. Raises UseError where everybody could, and FileError for what is no token."""
        if not is_loopback(self.listen) and self.token is None:
            problem = f"{self.listen} can be reached by other computers"
            remedy = "give --token FILE as well, or put a proxy that asks who it is before 127.0.0.1"
            raise UseError("--listen", problem, remedy)
        return Gate.of([self.listen, *self.names], token_of(self.token) if self.token else None)


def run_window(asked: Asked, say: Callable[[str], object]) -> None:
    """Serve until SIGINT or SIGTERM; say where. Raises RigError where that cannot be."""
    gate = asked.gate()
    if asked.session and asked.rig_file is None:
        raise UseError("--session", "needs the rig file of its cell", "give CELL")
    rig = load(asked.rig_file)[0] if asked.rig_file is not None else None
    place = Place(asked.session or Path(f"session-{rig.name}")) if rig else None
    shelf = Shelf(asked.runs or (place.runs if place and place.file.exists() else Path("runs")))
    sock = listening(asked.listen, asked.port)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))  # what was made and started here is removed and ended
    with ExitStack() as ends:
        made = Made(Path(ends.enter_context(tempfile.TemporaryDirectory(prefix="rig-window-"))))
        stream = None
        if asked.foxglove is not None:
            stream = Foxglove(asked.foxglove, rig, gate)
            ends.callback(stream.close)
            say(f"ws://127.0.0.1:{stream.port}{'/?token=TOKEN' if gate.token else ''} for Foxglove")
        begin = place.command(asked.rig_file) if place and asked.rig_file else ""
        daemon = partial(find_socket, rig.name if rig else None)
        watcher = Watcher(daemon, place, stream.show if stream else None, begin=begin)
        controls = None
        if asked.control:
            controls = Controls(watcher, place, str(find(asked.rig_file).resolve()) if asked.rig_file else "")
            ends.callback(controls.close)
        ends.callback(signal.signal, signal.SIGINT, signal.SIG_IGN)
        where = f"[{asked.listen}]" if ":" in asked.listen else asked.listen
        say(f"http://{where}:{sock.getsockname()[1]}{' with control' if controls else ''}; Ctrl-C ends it")
        remark = "" if shelf.directory.is_dir() else ", which is not there yet"
        cell = rig.name if rig else "the only cell that rigd serves"
        say(f"showing {cell}, and the runs in {shelf.directory}{remark}")
        serve(app_of(Window(watcher, shelf, place, made, gate, controls)), sock, watcher.board.end)
