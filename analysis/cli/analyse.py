"""`rig analyse RUN…`: the figures of recorded runs, as a table, as JSON, as pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from analysis.cli import app
from analysis.cli.console import say, say_json


@app.command()
def analyse(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN…", help="Run directories.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")] = False,
    plot: Annotated[
        Path | None, typer.Option(help="Directory for pictures; default: write none. A page: rig report.")
    ] = None,
    each: Annotated[
        bool, typer.Option("--each", help="Show each run beside the mean of repeated runs; default: the means.")
    ] = False,
    truth: Annotated[
        Path | None,
        typer.Option(help="File truth.json of an emulated cell, to show beside the figures; default: none."),
    ] = None,
) -> None:
    """Evaluate runs of any test (yaw, roll, radial, repeatability, pose); every figure has its uncertainty."""
    from analysis import evaluate_runs, load_run  # noqa: PLC0415
    from analysis.reporting.run_report import as_object, as_tables  # noqa: PLC0415
    from analysis.reporting.truth import compare  # noqa: PLC0415

    results = evaluate_runs([load_run(run) for run in runs])
    truths = compare(results, truth) if truth else []
    if plot:
        from analysis.reporting.plots import save_all_pictures  # noqa: PLC0415

        for picture in save_all_pictures(results, plot):
            say(f"wrote {picture}", err=True)
    if as_json:
        say_json(as_object(results, truths))
        return
    from analysis.reporting.plain_console import PlainConsole  # noqa: PLC0415

    PlainConsole().print(as_tables(results, truths, each=each))
