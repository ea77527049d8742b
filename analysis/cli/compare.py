"""`rig compare RUN…`: simulation and measurement laid over each other."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from analysis.cli import app


@app.command()
def compare(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN…", help="Run directories of one robot.")],
    rig_file: Annotated[
        str | None, typer.Option("--rig", help="The model to compare with; without it, the first run's rig file.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
    plot: Annotated[Path | None, typer.Option(help="Write a picture of each run into this directory.")] = None,
) -> None:
    """Simulate each run from its own feedback, fit the set-up, and show measured and simulated side by side."""
    import json  # noqa: PLC0415

    from rich.console import Console  # noqa: PLC0415

    import analysis  # noqa: PLC0415
    from analysis.reporting import comparison_report  # noqa: PLC0415

    found = analysis.compare([analysis.load_run(path) for path in runs], rig_file)
    if plot:
        for path in comparison_report.save_pictures(found.runs, plot):
            typer.echo(path, err=True)
    if as_json:
        typer.echo(json.dumps(found.to_dict(), indent=2))
    else:
        Console().print(comparison_report.as_tables(found))
