"""Command `rigd RIG`: the daemon in the foreground, for a terminal or for systemd."""

from __future__ import annotations

import logging
import os
import signal
import sys
import threading
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue
from types import FrameType
from typing import Annotated

import typer
from typer.exceptions import TyperException

from daq.service import journal
from daq.service.daemon import Daemon
from daq.service.trust import socket_directory
from daq.store.ledger import Ending
from rigs.distribution import version
from rigs.errors import RigError, UseError, wrong_use
from rigs.load import load
from rigs.signals import end_from, ignore_interrupts
from rigs.text import escape_text, forget_width_of_0

app = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)
log = logging.getLogger("rigd")


def main() -> None:
    forget_width_of_0()
    try:
        sys.exit(app(standalone_mode=False))
    except TyperException as error:
        refusal = wrong_use(error, "rigd")
        if refusal is not None:
            typer.echo(f"error: {refusal}", err=True)
        sys.exit(UseError.exit_code)
    finally:
        ignore_interrupts()


def _version(asked: bool) -> None:
    if asked:
        typer.echo(f"rigd {version()}")
        raise typer.Exit


@app.command()
def rigd(
    rig_file: Annotated[str, typer.Argument(metavar="RIG", help="Rig file, or the name of a shipped rig.")],
    runs: Annotated[
        Path | None, typer.Option(help="Directory for the runs; default: runs, under systemd its state directory.")
    ] = None,
    socket: Annotated[
        Path | None, typer.Option(help="Path of the control socket; default: in the runtime directory of the user.")
    ] = None,
    capture: Annotated[
        Path | None, typer.Option(help="File for the raw bytes of every link, for rig replay; default: none.")
    ] = None,
    metrics: Annotated[
        Path | None,
        typer.Option(help="File for the textfile collector of node_exporter; default: none, under systemd rig.prom."),
    ] = None,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Read the gauges and the robot of RIG until stopped; record when asked by `rig record`."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(journal.formatter())
    logging.basicConfig(level=logging.INFO, handlers=[handler])
    ends = _listen()
    try:
        rig, text = load(rig_file)
        socket = socket or socket_directory() / f"{rig.name}.sock"
        if metrics is None and "RUNTIME_DIRECTORY" in os.environ:  # systemd provides a directory for metrics and socket
            metrics = socket_directory() / "rig.prom"
        state = os.environ.get("STATE_DIRECTORY")
        runs = runs or (Path(state.split(":")[0]) / "runs" if state else Path("runs"))
        daemon = Daemon(rig, text, runs.absolute(), socket, capture, metrics)
        daemon.start()
    except RigError as error:
        for line in error.lines():
            typer.echo(journal.with_severity(f"error: {escape_text(line)}", journal.ERROR), err=True)
        raise typer.Exit(error.exit_code) from None
    end = end_from(ends)
    log.info("stopping: %s", end.why)
    cut_short = daemon.close(end.exit_status, end.why)
    if cut_short:
        typer.echo(f"The recording was interrupted, but all data are safe: {escape_text(str(cut_short))}", err=True)
    raise typer.Exit(end.exit_code)


@dataclass(frozen=True)
class _ExitReason:
    why: str
    exit_status: Ending
    exit_code: int


def _listen() -> SimpleQueue[_ExitReason]:
    """Queue that receives the end of the daemon: a signal, or an unexpected error in a thread.

    With a failed thread the daemon would appear to work but record incompletely. It ends, and the service manager
    restarts it.
    """
    ends: SimpleQueue[_ExitReason] = SimpleQueue()

    def signalled(number: int, _: FrameType | None) -> None:
        name = signal.Signals(number).name
        ends.put(_ExitReason(f"rigd was stopped by {name}", "interrupted", 130 if number == signal.SIGINT else 0))

    def died(args: threading.ExceptHookArgs) -> None:
        name = args.thread.name if args.thread else "unknown"
        error = args.exc_value or args.exc_type()
        log.critical("thread %r died", name, exc_info=error)
        ends.put(_ExitReason(f"rigd failed in thread {name!r}: {error!r}", "failed", 1))

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signalled)
    threading.excepthook = died
    return ends
