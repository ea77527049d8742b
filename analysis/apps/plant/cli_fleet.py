"""`rig fleet DIR|URL`: list the robots of a plant, most urgent first."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated

import typer

from analysis.cli.commands import app, command
from analysis.cli.console import CountedProgress, say, say_json, say_written
from analysis.cli.options import AsJson, Jobs, Scheduler, location

if TYPE_CHECKING:
    from analysis.apps.plant.collect import Workers
    from analysis.apps.plant.gather import Fleet, Progress


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
    from analysis.apps.plant import catalogue as kept
    from analysis.apps.plant.collect import Workers
    from analysis.apps.plant.gather import gather
    from rigs.errors import CellError

    if output:
        from analysis.apps.report.html_page import check_page_file

        check_page_file(output)
    if parquet:
        from analysis.runs.written_files import refuse_foreign

        refuse_foreign(parquet, "--parquet")
    if catalogue:
        kept.refuse_foreign(catalogue)
    workers, progress = Workers(jobs, scheduler), CountedProgress()
    with ExitStack() as until_written:
        file = catalogue or kept.default_path(directory)
        if not catalogue:
            try:
                kept.require_writable(file)
            except CellError as error:  # Use a temporary catalogue, which only saves time.
                say(f"{error.where}: {error.what}; all runs must be read each time: give --catalogue FILE", err=True)
                file = Path(until_written.enter_context(TemporaryDirectory())) / file.name
        try:
            with progress:
                plant = gather(directory, file, workers, progress)
            _write(plant, output, parquet, workers, progress)
        except kept.Damaged:
            kept.remove(file)  # The error message announces that the next start rebuilds it.
            raise
    from analysis.apps.plant import fleet_screen as screen

    if as_json:
        say_json(screen.as_object(plant))
    else:
        from analysis.apps.report.blocks import say_answer

        say_answer(screen.answer_of(plant))


def _write(plant: Fleet, output: Path | None, parquet: Path | None, workers: Workers, progress: Progress) -> None:
    """Write the requested files."""
    if parquet:
        from analysis.apps.plant.fleet_screen import write_figures

        write_figures(plant, parquet)
        say_written([parquet])
    if output:
        from analysis.apps.plant.fleet_page import write_pages

        for line in write_pages(plant, output, workers, progress):
            say(f"warning: {line}", err=True)
        say_written([output])
