"""`rig report RUN… -o FILE.html`: a page for the decision maker."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import typer

from analysis.cli.commands import app, command
from analysis.cli.console import progress_of, say_written
from analysis.cli.options import Calibration, Jobs, RobotRunsBelow, Scheduler, rig_option
from analysis.cli.several import (
    end_with,
    evaluate_paths,
    runs_below,
    say_doubts,
    with_controller,
    with_tables,
    worst_code,
)
from rigs.text import as_argument


@command(app, "rig report runs/* -o report.html")
def report(
    runs: RobotRunsBelow,
    output: Annotated[
        Path,
        typer.Option("--output", "-o", metavar="FILE.html", help="The page to write; FILE.pdf with the extra pdf."),
    ],
    rig_file: Annotated[
        str | None,
        rig_option("Rig file with the model and the limits, or an arm of the library; default: that of the first run."),
    ] = None,
    lang: Annotated[Literal["en", "de", "ko"], typer.Option(help="Language of the fixed texts.")] = "en",
    customer: Annotated[str, typer.Option(help="Customer, shown at the head of the page; default: none.")] = "",
    calibration: Calibration = None,
    order: Annotated[str, typer.Option(help="Order number, shown at the head of the page; default: none.")] = "",
    serial: Annotated[str, typer.Option(help="Serial number of the robot; default: that of the rig file.")] = "",
    diagnosis: Annotated[
        bool, typer.Option("--diagnosis/--no-diagnosis", help="Search for the cause of the errors, or skip the search.")
    ] = True,
    jobs: Jobs = 1,
    scheduler: Scheduler = None,
) -> None:
    """Write a report page: verdict against the limits, causes and remedies, and every test with pictures.

    The page needs no other files and no network, and prints on A4. It lists runs
    that could not be evaluated.
    """
    from analysis.apps.report.cli_diagnose import with_commands_here
    from analysis.apps.report.html_page import check_page_file, check_pdf_output, is_pdf
    from analysis.apps.report.page.write_page import PageHead, gather, write_page
    from rigs.load import load

    heading = PageHead(serial, customer, order)
    heading.check()
    (check_pdf_output if is_pdf(output) else check_page_file)(output)
    own_file = with_controller(rig_file, calibration)
    model = load(own_file)[0] if own_file else None
    paths = [run.resolve() for run in runs_below(with_tables(runs, own_file))]
    results, errors = evaluate_paths(paths, jobs=jobs, scheduler=scheduler)
    if results:
        say_doubts(result.measured for result in results)
        with progress_of() as progress:
            gathered = gather(results, model, diagnosed=diagnosis, left_out=errors, progress=progress)
            if gathered.found:
                model_words = ("--rig", as_argument(rig_file)) if rig_file else ()
                again = ("diagnose", *map(as_argument, runs), *model_words)
                gathered = replace(gathered, found=with_commands_here(gathered.found, None, again))
            progress("drawing the pictures")
            written = write_page(gathered, output, lang, heading)
        say_written([written])
    end_with(worst_code(errors))
