"""`rig report RUN… -o FILE.html`: one page for the person who decides."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from analysis.cli import app, completion
from analysis.cli.commands import command
from analysis.cli.console import say
from analysis.cli.options import RobotRuns


@command(app, "rig report runs/* -o report.html")
def report(
    runs: RobotRuns,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE.html", help="The page to write.")],
    rig_file: Annotated[
        str | None,
        typer.Option(
            "--rig",
            autocompletion=completion.rig_files,
            help="Rig file with the model and the limits; default: that of the first run.",
        ),
    ] = None,
    lang: Annotated[Literal["en", "de", "ko"], typer.Option(help="Language of the fixed texts.")] = "en",
    diagnosis: Annotated[
        bool, typer.Option("--diagnosis/--no-diagnosis", help="Search for the cause of the errors, or leave it out.")
    ] = True,
) -> None:
    """Write one page: the verdict against the limits, what is wrong and what to do, then every test with pictures.

    The page needs no other file and no network, and prints to A4."""
    from analysis.cli.progress import progress_of  # noqa: PLC0415
    from analysis.cli.run_paths import distinct, load_runs  # noqa: PLC0415
    from analysis.reporting.page.report import gather  # noqa: PLC0415
    from analysis.reporting.page.write_page import hold_page, write_page  # noqa: PLC0415
    from rigs.load import load  # noqa: PLC0415

    hold_page(output)
    measured = load_runs(distinct(runs))
    with progress_of() as progress:
        gathered = gather(measured, load(rig_file)[0] if rig_file else None, diagnosed=diagnosis, progress=progress)
        progress("drawing the pictures")
        written = write_page(gathered, output, lang)
    say(f"wrote {written}", err=True)
