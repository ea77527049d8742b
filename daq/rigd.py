"""The command `rigd RIG`: the daemon in the foreground, for a terminal or for systemd."""

from __future__ import annotations

import logging
import os
import signal
import sys
import threading
from pathlib import Path
from typing import Annotated

import typer

from daq.control import socket_directory
from daq.daemon import Daemon
from rigs.errors import RigError
from rigs.load import load

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
log = logging.getLogger("rigd")


def main() -> None:
    """Entry point."""
    app()


@app.command()
def rigd(
    rig_file: Annotated[str, typer.Argument(metavar="RIG", help="Rig file, or the name of a shipped rig.")],
    runs: Annotated[
        Path | None, typer.Option(help="Where run directories go. [default: runs, under systemd its state]")
    ] = None,
    socket: Annotated[
        Path | None, typer.Option(help="Control socket. [default: in the user's runtime directory]")
    ] = None,
) -> None:
    """Read the gauges and the robot of RIG until stopped; record when asked by `rig record`."""
    logging.basicConfig(level=logging.INFO, format=_log_format(), stream=sys.stderr)
    signalled = threading.Event()
    received: list[int] = []

    def note(number: int, _: object) -> None:
        received.append(number)
        signalled.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, note)
    try:
        rig, text = load(rig_file)
        daemon = Daemon(rig, text, runs or _runs(), socket or socket_directory() / f"{rig.name}.sock")
    except RigError as error:
        for line in error.lines():
            typer.echo(f"error: {line}", err=True)
        raise typer.Exit(error.exit_code) from None
    signalled.wait()
    name = signal.Signals(received[0]).name
    log.info("%s: stopping", name)
    cut_short = daemon.close(f"rigd was stopped by {name}")
    if cut_short:
        typer.echo(f"the recording was cut short and is safe: {cut_short}", err=True)
    raise typer.Exit(130 if received[0] == signal.SIGINT else 0)


def _runs() -> Path:
    state = os.environ.get("STATE_DIRECTORY")
    return Path(state.split(":")[0]) / "runs" if state else Path("runs")


def _log_format() -> str:
    """The journal stamps its lines itself."""
    return "%(levelname)s %(message)s" if "JOURNAL_STREAM" in os.environ else "%(asctime)s %(levelname)s %(message)s"
