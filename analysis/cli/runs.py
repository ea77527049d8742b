"""`rig runs`, `rig keep`, `rig recover`, `rig verify`: which runs there are, which stay, and whether one is whole."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from analysis.cli import app
from analysis.cli.console import say, say_json

RunPath = Annotated[Path, typer.Argument(metavar="RUN", help="Run directory.")]


@app.command()
def runs(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="Directory that holds the runs.")] = Path("runs"),
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON list.")] = False,
) -> None:
    """List runs with size and age, whether they were exported, and whether they are kept for ever."""
    import time  # noqa: PLC0415

    from analysis.reporting.runs_list import listed, row  # noqa: PLC0415
    from daq.store import survey  # noqa: PLC0415

    found = [row(run, time.time()) for run in survey(directory)]
    if as_json:
        say_json(found)
        return
    if not found:
        say(f"no runs in {directory}")
        return
    from analysis.reporting.plain_console import PlainConsole  # noqa: PLC0415

    table = listed(found)
    whole = PlainConsole(width=10_000).measure(table).maximum
    # A directory in pieces cannot be copied: a line stays one, however narrow the terminal is.
    PlainConsole(width=max(whole, PlainConsole().width)).print(table)


@app.command()
def keep(
    paths: Annotated[list[Path], typer.Argument(metavar="RUN", help="Run directories.")],
    no_more: Annotated[bool, typer.Option("--not", help="No more: retention may delete them once exported.")] = False,
) -> None:
    """Mark runs as kept for ever: whatever the rig file's retention says, rigd never deletes them."""
    from daq.store import mark_kept  # noqa: PLC0415

    for path in paths:
        mark_kept(path, not no_more)
        say(f"{path}: {'not kept any more' if no_more else 'kept'}")


@app.command()
def recover(path: RunPath) -> None:
    """Bring a run that was cut off into order: keep every verified batch, say what is lost."""
    from daq.store import recover as recover_run  # noqa: PLC0415

    done = recover_run(path)
    for stream, rows in done.rows.items():
        say(f"{stream}: {rows} rows recovered")
    for note in done.notes:
        say(note)
    for file, loss in done.losses.items():
        say(f"lost: {file}: {loss}")
    say(f"{path}: nothing to do" if done.nothing_to_do else f"{path}: recovered; next: rig verify {path}")


@app.command()
def verify(path: RunPath) -> None:
    """Say whether a run is whole, recovered or not whole; exit code 3 where something is wrong or missing."""
    from daq.store import judge  # noqa: PLC0415

    verdict = judge(path)
    for line in verdict.lines:
        say(line, err=True)
    say(verdict.summary)
    if verdict.lines:
        raise typer.Exit(3)
