"""`rig export RUN`: the table of a run for other programs, or its streams for plotting."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from analysis.cli import app
from analysis.cli.commands import command
from analysis.cli.console import say

Format = Literal["csv", "parquet", "mcap"]


@command(app, "rig export runs/lap-acw --to parquet -o lap-acw.parquet")
def export(
    path: Annotated[Path, typer.Argument(metavar="RUN", help="Run directory.")],
    to: Annotated[Format, typer.Option(help="Format: csv or parquet for the table, mcap for the raw streams.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="File to write.")],
) -> None:
    """Write the table of a run as CSV or Parquet, or its raw streams as MCAP for Foxglove and PlotJuggler."""
    from functools import partial  # noqa: PLC0415

    from analysis.files.mcap_export import write_mcap  # noqa: PLC0415
    from analysis.files.write import write_csv, write_new, write_parquet  # noqa: PLC0415
    from analysis.traces.loading import measured_of  # noqa: PLC0415
    from daq.store import mark_exported, read_run  # noqa: PLC0415
    from rigs.errors import RigError  # noqa: PLC0415

    run = read_run(path)
    if to == "mcap":
        write_new(output, partial(write_mcap, run))
    else:
        measured = measured_of(run)
        for doubt in measured.doubts:
            say(f"note: {doubt}", err=True)
        write_new(output, partial(write_csv if to == "csv" else write_parquet, measured.to_table()))
    try:
        mark_exported(path, to, output)
    except RigError as error:
        say(f"note: {path} could not be marked as exported, so rigd will not delete it: {error.what}", err=True)
    say(output)
