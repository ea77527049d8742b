"""`rig recover RUN` and `rig verify RUN`: what a crash left, and whether a run is whole."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from analysis.cli import app

RunPath = Annotated[Path, typer.Argument(metavar="RUN", help="Run directory.")]


@app.command()
def recover(path: RunPath) -> None:
    """Bring a run that was cut off into order: keep every verified batch, say what is lost."""
    from daq.store import recover as recover_run  # noqa: PLC0415

    done = recover_run(path)
    for stream, rows in done.rows.items():
        typer.echo(f"{stream}: {rows} rows recovered")
    for note in done.notes:
        typer.echo(note)
    for file, loss in done.losses.items():
        typer.echo(f"lost: {file}: {loss}")
    typer.echo(f"{path}: nothing to do" if done.nothing_to_do else f"{path}: recovered; next: rig verify {path}")


@app.command()
def verify(path: RunPath) -> None:
    """Check every chunk of a run against its manifest; exit code 3 where something is wrong."""
    from daq.store import verify as verify_run  # noqa: PLC0415

    problems = verify_run(path)
    for problem in problems:
        typer.echo(problem, err=True)
    if problems:
        raise typer.Exit(3)
    typer.echo(f"{path}: whole")
