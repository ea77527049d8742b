"""`rig compare RUN…`: simulation and measurement laid over each other."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from analysis.cli import app
from analysis.cli.console import say, say_json


@app.command()
def compare(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN…", help="Run directories of one robot.")],
    rig_file: Annotated[
        str | None, typer.Option("--rig", help="Rig file of the model to compare with; default: that of the first run.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")] = False,
    plot: Annotated[Path | None, typer.Option(help="Directory for a picture of each run; default: write none.")] = None,
) -> None:
    """Simulate each run from its own feedback, fit the set-up, and show measured and simulated side by side."""

    import analysis  # noqa: PLC0415
    from analysis.reporting import comparison_report  # noqa: PLC0415
    from analysis.reporting.plain_console import PlainConsole  # noqa: PLC0415

    found = analysis.compare([analysis.load_run(path) for path in runs], rig_file)
    if plot:
        for path in comparison_report.save_pictures(found.runs, plot):
            say(path, err=True)
    if as_json:
        say_json(found.to_dict())
    else:
        PlainConsole().print(comparison_report.as_tables(found))
