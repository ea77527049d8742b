"""`rig fleet DIR|URL`: list the robots of a plant, most urgent first."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from analysis.cli.commands import app, command
from analysis.cli.console import CountedProgress, say, say_json, say_written
from analysis.cli.options import AsJson, Jobs, Scheduler, location


@command(app, "rig fleet /srv/plant -o plant.html")
def fleet(
    directory: Annotated[
        Path,
        typer.Argument(
            metavar="DIR|URL", parser=location, help="Directory of the plant, including all runs in subdirectories."
        ),
    ],
    as_json: AsJson = False,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE.html",
            help="Overview page to write, with a page for each robot in the same directory; default: none.",
        ),
    ] = None,
    parquet: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Output table with the results of all runs; default: none.")
    ] = None,
    catalogue: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Catalogue of the results; default: in the user's cache.")
    ] = None,
    jobs: Jobs = 0,
    scheduler: Scheduler = None,
) -> None:
    """List the robots of a plant: state against limits, what changed and since when, runs and doubts.

    Runs in the same directory with the same rig name belong to one robot. The
    figures are stored in a catalogue, so unchanged runs are read only once."""
    from analysis.apps.plant import fleet_report as report
    from analysis.apps.plant import store
    from analysis.apps.plant.collect import Workers
    from analysis.apps.plant.fleet import gather

    if output:
        from analysis.apps.report.html_page import check_page_file

        check_page_file(output)
    if parquet:
        from analysis.runs.written_files import refuse_foreign

        refuse_foreign(parquet, "--parquet")
    workers, file = Workers(jobs, scheduler), catalogue or store.default_path(directory)
    with (progress := CountedProgress()):
        plant = gather(directory, file, workers, progress)
    if parquet:
        report.write_figures(plant, parquet)
        say_written([parquet])
    if output:
        for line in report.write_pages(plant, output, workers, progress):
            say(f"warning: {line}", err=True)
        say_written([output])
    if as_json:
        say_json(report.as_object(plant))
    else:
        from analysis.apps.report.blocks import say_answer

        say_answer(report.fleet_answer(plant))
