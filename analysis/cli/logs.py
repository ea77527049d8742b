"""`rig logs [RIG]`: what the service said, for a person."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from analysis.cli import completion
from analysis.cli.commands import app, command
from rigs.text import plain

if TYPE_CHECKING:
    from daq.service.journal import Entry


@command(app, "rig logs cell --since today")
def logs(
    rig: Annotated[
        str | None,
        typer.Argument(
            metavar="RIG",
            autocompletion=completion.services,
            help="NAME of rigd@NAME, or its rig file; default: all services.",
        ),
    ] = None,
    since: Annotated[
        str | None, typer.Option(help="Time of the first entry: today, -1h, '2026-11-20 08:00'; default: the oldest.")
    ] = None,
    follow: Annotated[
        bool, typer.Option("--follow", "-f", help="Show new entries until Ctrl-C; default: stop at the last.")
    ] = False,
) -> None:
    """Show what the services rigd@NAME have logged, and when systemd started and stopped them."""
    import contextlib
    from pathlib import Path

    from daq.service.journal import read

    name = rig and Path(rig).name.removesuffix(".yaml")
    with contextlib.suppress(KeyboardInterrupt):
        for entry in read(name, since, follow=follow):
            typer.echo(line(entry, named=rig is None))


def line(entry: Entry, *, named: bool) -> str:
    """One line: time, severity where it is worth a look, and text; with the rig's name where there are several."""
    from daq.service.journal import ERROR, INFO, WARNING

    if entry.severity <= ERROR:
        word, colour = "error", "red"
    elif entry.severity == WARNING:
        word, colour = "warning", "yellow"
    else:
        word, colour = "", None
    who = f"{plain(entry.rig):10} " if named else ""
    text = plain(f"systemd: {entry.text}" if entry.by_systemd else entry.text)
    return f"{entry.at:%Y-%m-%d %H:%M:%S} {who}" + typer.style(
        f"{word:8}{text}", fg=colour, dim=entry.severity >= INFO and entry.by_systemd
    )
