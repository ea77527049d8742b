"""`rig replay LOG RIG`: what a cell once said, said again to the real daemon."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from analysis.cli import completion
from analysis.cli.commands import app, command
from analysis.cli.console import say

if TYPE_CHECKING:
    from queue import SimpleQueue

    from daq.emulators import Replay


@command(app, "rig replay cell.log cell.yaml -o replayed")
def replay(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="File that `rigd --capture` wrote.")],
    rig_file: Annotated[
        str,
        typer.Argument(
            metavar="RIG", autocompletion=completion.rig_files, help="Rig file that the capture was made with."
        ),
    ],
    directory: Annotated[Path, typer.Option("--output", "-o", help="Directory for rig.yaml.")] = Path("replayed"),
) -> None:
    """Serve the instruments of a capture on ptys and local ports, at the times of the capture, until its end.

    Writes rig.yaml, the rig file with these ports in it, for rigd. The time
    of all of them begins with the daemon's first word. A run that is
    recorded while one is out of step is marked, and rig analyse refuses it.
    """
    from analysis.emulation.served_cell import MARKS, locked_cell, rig_file_of_cell, serve
    from daq.emulators import Replay
    from daq.store import durable
    from daq.wire.capture import read_capture
    from rigs.errors import FileError
    from rigs.load import load

    rig, text = load(rig_file)
    path = rig_file_of_cell(directory)
    capture = read_capture(log)
    lock = locked_cell(directory)
    try:
        played = Replay.open(rig, capture, directory / MARKS)
        for name, content in rig.beside.items():
            durable.replace(directory / name, content)
        durable.replace(path, played.rig_text(text).encode())
    except OSError as error:
        raise FileError(str(directory), error.strerror or str(error), "give another --output") from None

    def attend(ends: SimpleQueue[int]) -> int:
        for name, port in played.cell.ports.items():
            say(f"{name}: {port}")
        if capture.cut:
            say(f"{log}: ends in the middle of a line; that line is ignored", err=True)
        say(f"ready; next: rigd {path}")
        return _end(played, ends)

    exit_code, sent = serve(played.cell, lock, attend)
    for name, count in sent.items():
        say(f"{name}: {count} pieces sent, {played.steps[name].words()}")
    if played.restarts:
        say(f"restarts from the beginning, because the host left a connection before its end: {played.restarts}")
    if played.unmarked:
        raise FileError(
            str(directory), f"cannot mark the runs that are out of step: {played.unmarked}", "give another --output"
        )
    doubt = "; was it captured with another rig file?" if played.otherwise else ""
    say(f"{played.otherwise} pieces from the host differ from the capture{doubt}")
    raise typer.Exit(exit_code)


def _end(played: Replay, ends: SimpleQueue[int]) -> int:
    """The exit code, once all is said or a signal has come."""
    from queue import Empty

    while not played.done:
        try:
            return ends.get(timeout=0.1)
        except Empty:
            continue
    return 0
