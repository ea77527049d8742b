"""`rig history ROBOT`: show every figure of a robot over all runs, with changes and dates."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Annotated

import typer

from analysis.cli import completion
from analysis.cli.commands import app, command
from analysis.cli.console import CountedProgress, say, say_json, say_written
from analysis.cli.options import AsJson, Jobs, Scheduler, location


@command(app, "rig history ur10e --since 2026-01-01 -o history.html")
def history(
    robot: Annotated[
        str,
        typer.Argument(
            metavar="ROBOT",
            autocompletion=completion.robots,
            help="Name of the rig file, or of the robot in it.",
        ),
    ],
    runs: Annotated[
        Path,
        typer.Option(metavar="DIR|URL", parser=location, help="Directory with the runs, including subdirectories."),
    ] = Path("runs"),
    figure: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="A single quantity, such as band_deg; default: all quantities that describe the robot."
        ),
    ] = None,
    since: Annotated[
        datetime | None, typer.Option(metavar="YYYY-MM-DD", formats=["%Y-%m-%d"], help="First day; default: all runs.")
    ] = None,
    rig_file: Annotated[
        str | None, typer.Option("--rig", help="Rig file with the limits; default: the rig file of the newest run.")
    ] = None,
    as_json: AsJson = False,
    as_csv: Annotated[bool, typer.Option("--csv", help="Print a CSV line for each run and quantity.")] = False,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE.html", help="Page to write; default: write none.")
    ] = None,
    jobs: Jobs = 0,
    scheduler: Scheduler = None,
) -> None:
    """Show each figure of a robot over time, and report what changed by more than the scatter between its runs."""
    from analysis.apps.plant.collect import Workers, collect
    from analysis.apps.plant.history import history_of
    from rigs.errors import UseError
    from rigs.load import load
    from rigs.text import as_argument

    if as_json and as_csv:
        raise UseError("--json and --csv", "cannot both be printed", "give one of them")
    if output:
        from analysis.apps.report.html_page import check_page_file

        check_page_file(output)
    if Path(robot).is_dir() and runs == Path("runs") and (robot != Path(robot).name or not runs.is_dir()):
        remedy = f"give the name of the robot: rig history NAME --runs {as_argument(robot)}"
        raise UseError(robot, "is a directory, not the name of a robot", remedy, code="usage")
    collected = collect(runs, robot, Workers(jobs, scheduler), CountedProgress())
    limits = load(rig_file)[0].limits if rig_file else None
    history_found = history_of(collected, figure, since.date() if since else None, limits)
    from analysis.apps.plant import history_report as report

    if output:
        report.write_page(history_found, output)
        say_written([output])
    if as_json:
        say_json(report.as_object(history_found))
    elif as_csv:
        import io

        from analysis.runs.written_files import write_csv

        text = io.BytesIO()
        write_csv(report.as_table(history_found.series), text)
        for line in text.getvalue().decode().splitlines():
            say(line)
    else:
        from analysis.apps.report.blocks import say_answer

        say_answer(report.history_answer(history_found))
