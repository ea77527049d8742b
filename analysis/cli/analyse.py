"""`rig analyse RUN…`: the figures of recorded runs, as a table, as JSON, as pictures and a report."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from analysis.cli import app


@app.command()
def analyse(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN…", help="Run directories.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
    plot: Annotated[Path | None, typer.Option(help="Write pictures and report.html into this directory.")] = None,
    each: Annotated[bool, typer.Option("--each", help="Show every run beside the mean of repeated ones.")] = False,
    truth: Annotated[
        Path | None, typer.Option(help="truth.json of an emulated cell, to set beside the figures.")
    ] = None,
) -> None:
    """Evaluate runs of every test: yaw, roll, radial, repeatability, pose; each figure with its uncertainty."""
    from analysis import evaluate_runs, load_run  # noqa: PLC0415
    from analysis.reporting.run_report import as_object, as_tables, write_report  # noqa: PLC0415
    from analysis.reporting.truth import compare  # noqa: PLC0415

    results = evaluate_runs([load_run(run) for run in runs])
    truths = compare(results, truth) if truth else []
    if plot:
        report = write_report(results, plot)
        typer.echo(f"report: {report}", err=True)
    if as_json:
        import json  # noqa: PLC0415

        typer.echo(json.dumps(as_object(results, truths), indent=2))
        return
    from rich.console import Console  # noqa: PLC0415

    Console().print(as_tables(results, truths, each=each))
