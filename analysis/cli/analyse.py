"""`rig analyse RUN…`: the figures of recorded runs, as a table, as JSON, as pictures."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import typer

from analysis.cli import app
from analysis.cli.commands import command
from analysis.cli.console import say, say_json
from analysis.cli.options import AsJson, Runs


@command(app, "rig analyse runs/lap-acw runs/lap-cw --plot pictures")
def analyse(
    runs: Runs,
    as_json: AsJson = False,
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
    from analysis.cli.progress import progress_of  # noqa: PLC0415
    from analysis.reporting.run_report import as_object, as_tables  # noqa: PLC0415
    from analysis.reporting.truth import compare  # noqa: PLC0415

    with progress_of() as progress:
        measured = [load_run(run) for run in runs]
        progress(f"evaluating {len(runs)} runs")
        results = evaluate_runs(measured)
        truths = compare(results, truth) if truth else []
        pictures: Iterable[Path] = ()
        if plot:
            from analysis.reporting.plots import save_all_pictures  # noqa: PLC0415

            progress("drawing the pictures")
            pictures = list(save_all_pictures(results, plot))
    for picture in pictures:
        say(f"wrote {picture}", err=True)
    if as_json:
        say_json(as_object(results, truths))
        return
    from analysis.reporting.plain_console import PlainConsole  # noqa: PLC0415

    PlainConsole().print(as_tables(results, truths, each=each))
