"""`rig window` serves the cell, its session and its runs to browsers."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from analysis.cli import completion
from analysis.cli.commands import app, command
from analysis.cli.console import say

_PORT = 8700


@command(app, "rig window cell.yaml")
def window(
    rig_file: Annotated[
        str | None,
        typer.Argument(
            metavar="CELL",
            autocompletion=completion.rig_files,
            help="Rig file of the cell; default: the only running daemon, without a session.",
        ),
    ] = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port of the server; 0 selects a free port.")] = _PORT,
    listen: Annotated[
        str,
        typer.Option(metavar="ADDRESS", help="Address to listen on; addresses of other interfaces require --token."),
    ] = "127.0.0.1",
    token: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="File with the token that a browser must send; default: none required."),
    ] = None,
    name: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="Host name in the browser's address, for example behind a proxy; repeatable; default: --listen.",
        ),
    ] = None,
    control: Annotated[
        bool,
        typer.Option("--control", help="Allow recordings, zeroing, and continuing the session from the browser."),
    ] = False,
    foxglove: Annotated[
        int | None,
        typer.Option(hidden=True),
    ] = None,
    runs: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Directory of the runs; default: the directory of the session if available, otherwise runs.",
        ),
    ] = None,
    session: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Directory of the session; default: session-NAME.")
    ] = None,
) -> None:
    """Serve the live cell, its session, runs, reports and history to browsers, until Ctrl-C.

    Like rig live, the window is a client of rigd. It is reachable only from
    this computer unless --listen is given, and read-only unless --control is
    given. It never commands the robot.
    """
    from rigs.distribution import to_install
    from rigs.errors import CellError, UseError

    if foxglove is not None:
        raise UseError("--foxglove", "was removed", "open a run in Foxglove: rig export RUN --to mcap")
    try:
        from analysis.apps.window.serve import WindowOptions, run_window
    except ModuleNotFoundError as error:
        if error.name not in ("starlette", "uvicorn"):
            raise
        problem = f"needs the Python package {error.name}, which is not installed"
        raise CellError("rig window", problem, to_install("starlette", "uvicorn"), code="package.missing") from None
    asked = WindowOptions(rig_file, port, listen, token, tuple(name or ()), control, runs, session)
    run_window(asked, say)
