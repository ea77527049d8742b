"""`rig window [CELL]`: the live cell, its session and its runs in a browser."""

from __future__ import annotations

import signal
import sys
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from analysis.cli import app, completion
from analysis.cli.commands import command
from analysis.cli.console import say

_PORT = 8700


@command(app, "rig window cell.yaml")
def window(
    rig_file: Annotated[
        str | None,
        typer.Argument(
            metavar="CELL",
            autocompletion=completion.rig_files,
            help="Rig file of the cell; default: the only daemon that runs, without a session.",
        ),
    ] = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port to serve at; 0: any that is free.")] = _PORT,
    listen: Annotated[
        str,
        typer.Option(metavar="ADDRESS", help="Address to listen on; any but this computer's own needs --token."),
    ] = "127.0.0.1",
    token: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="File with the token that a browser must show; default: none is needed."),
    ] = None,
    name: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Host name under which it is reached, as behind a proxy; repeatable."),
    ] = None,
    control: Annotated[
        bool,
        typer.Option("--control", help="Allow to start and stop recordings, to zero, and to go on with the session."),
    ] = False,
    foxglove: Annotated[
        int | None,
        typer.Option(
            min=0, max=65535, metavar="PORT", help="Also serve gauges and joints to Foxglove at this port; default: no."
        ),
    ] = None,
    runs: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Directory of the runs; default: that of the session if there is one, or runs."
        ),
    ] = None,
    session: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Directory of the session; default: session-NAME.")
    ] = None,
) -> None:
    """Serve the live cell, its session, runs, reports and history to browsers, until Ctrl-C.

    It is a client of rigd, as rig live is, and only this computer reaches
    it unless --listen says otherwise. It reads only, unless --control is
    given; the robot is never commanded.
    """
    import tempfile  # noqa: PLC0415

    from analysis.session.state import Place  # noqa: PLC0415
    from analysis.window.guard import Gate, is_loopback, token_of  # noqa: PLC0415
    from daq.service.client import find_socket  # noqa: PLC0415
    from rigs.errors import CellError, UseError  # noqa: PLC0415
    from rigs.load import find, load  # noqa: PLC0415
    from rigs.text import to_install  # noqa: PLC0415

    if not is_loopback(listen) and token is None:
        what = f"{listen} can be reached by other computers"
        raise UseError(
            "--listen", what, "give --token FILE as well, or put a proxy that asks who it is before 127.0.0.1"
        )
    if session and rig_file is None:
        raise UseError("--session", "needs the rig file of its cell", "give CELL")
    gate = Gate.of([listen, *(name or [])], token_of(token) if token else None)
    rig, place = None, None
    if rig_file is not None:
        rig = load(rig_file)[0]
        place = Place(session or Path(f"session-{rig.name}"))
    try:
        from analysis.window.app import Window, app_of  # noqa: PLC0415
        from analysis.window.controls import Controls  # noqa: PLC0415
        from analysis.window.foxglove import Foxglove  # noqa: PLC0415
        from analysis.window.made import Made  # noqa: PLC0415
        from analysis.window.serve import listening, serve  # noqa: PLC0415
        from analysis.window.shelf import Shelf  # noqa: PLC0415
        from analysis.window.watcher import Watcher  # noqa: PLC0415
    except ModuleNotFoundError as error:
        if error.name not in ("starlette", "uvicorn"):
            raise
        what = f"needs {error.name}, which is not installed"
        raise CellError("rig window", what, to_install("starlette uvicorn")) from None

    sock = listening(listen, port)
    shelf = Shelf(runs or (place.runs if place and place.file.exists() else Path("runs")))
    stream = Foxglove(foxglove, rig) if foxglove is not None else None
    watcher = Watcher(partial(find_socket, rig.name if rig else None), place, stream.show if stream else None)
    controls = Controls(watcher, place, str(find(rig_file).resolve()) if rig_file else "") if control else None
    with tempfile.TemporaryDirectory(prefix="rig-window-") as directory:
        shown = f"[{listen}]" if ":" in listen else listen
        signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))  # what was made and started here is removed and ended
        if stream is not None:
            say(f"ws://127.0.0.1:{stream.port} for Foxglove")
        say(f"http://{shown}:{sock.getsockname()[1]}{' with control' if control else ''}; Ctrl-C ends it")
        try:
            serve(app_of(Window(watcher, shelf, place, Made(Path(directory)), gate, controls)), sock, watcher.board.end)
        finally:
            signal.signal(signal.SIGINT, signal.SIG_IGN)  # what was started here is ended in order
            if controls is not None:
                controls.close()
            if stream is not None:
                stream.close()
