"""`rig import TABLE…`: tables of measurements from elsewhere, and bags of ROS 2, as runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from analysis.cli import completion
from analysis.cli.commands import app, command
from analysis.cli.console import say
from analysis.cli.options import direction_option, operator_or_user
from analysis.cli.several import for_each
from analysis.runs.table_layout import JointSource
from rigs.errors import UseError
from rigs.schema.vocabulary import CIRCLES, Direction, TestName


@command(app, "rig import laps.csv --rig cell.yaml --test yaw -o runs/lap-acw", name="import")
def import_(
    tables: Annotated[
        list[Path],
        typer.Argument(metavar="TABLE…", help="CSV files, workbooks, or bags of ROS 2: docs/tables.md."),
    ],
    rig_file: Annotated[
        str, typer.Option("--rig", autocompletion=completion.rig_files, help="Rig file, or the name of a shipped rig.")
    ],
    test: Annotated[TestName, typer.Option(help="Test that the tables are of.")],
    output: Annotated[
        Path,
        typer.Option(
            "--output", "-o", help="Run directory to create; of several tables, the directory for a run named as each."
        ),
    ],
    direction: Annotated[
        Direction | None, direction_option("Direction of yaw and roll; default: the column direction of the table")
    ] = None,
    operator: Annotated[str, typer.Option(help="Name of the person who measured; default: the user.")] = "",
    placement: Annotated[
        str, typer.Option(help="Your name for where the instrument or the ball stood; default: none.")
    ] = "",
    joints: Annotated[
        JointSource, typer.Option(help="Joint angles to use: columns qN_deg, or qN_commanded_deg.")
    ] = "measured",
    map_file: Annotated[
        Path | None,
        typer.Option("--map", help="Map of the columns, as import proposes one; default: proposed where it is needed."),
    ] = None,
    join: Annotated[
        str,
        typer.Option(
            metavar="rows|COLUMN",
            help="The files are one measurement, joined row by row or by a column; default: a run of each file.",
        ),
    ] = "",
    topic: Annotated[
        str,
        typer.Option(
            help="Topic of the poses in a bag, of a transform /tf:CHILD; default: the only one that there is."
        ),
    ] = "",
    yes: Annotated[
        bool,
        typer.Option(
            "--yes", help="Take the likeliest answer to what a table leaves open; each becomes a doubt of the run."
        ),
    ] = False,
) -> None:
    """Create a run from each table of measurements; every bad row is reported with its line and the reason.

    Poses may come as their instrument wrote them: a map of the columns is
    proposed, checked by the arm of the rig file, shown, and kept in the run. What
    remains open is asked; without a terminal the map is written for you to
    complete, and nothing is imported.
    """
    from analysis import read_table, save_run
    from analysis.apps.interchange.bags import file_of
    from analysis.cli.console import progress_of
    from analysis.cli.import_map import mapped_run, needs_map
    from analysis.intake.table_map import MAPPED
    from analysis.runs.written_files import refuse_existing

    if direction and test not in CIRCLES:
        raise UseError("--direction", f"a {test} test has no direction", "leave it out")
    if topic and test != MAPPED:
        raise UseError("--topic", f"is of poses, and the test is {test}", "leave it out")
    operator = operator_or_user(operator)

    def make_run(table: Path) -> None:
        files = [file_of(source) for source in (tables if join else [table])]
        run = output / table.stem if len(tables) > 1 and not join else output
        refuse_existing(run)
        label: Any = {"direction": direction, "operator": operator, "placement": placement, "joints": joints}
        if join or map_file or needs_map(files[0], test):
            asked: Any = {"map_file": map_file, "join": join, "yes": yes, "topic": topic}
            measured = mapped_run(files, rig_file, test, run, **asked, **label)
        else:
            with progress_of(f"reading {table}"):
                measured = read_table(files[0], rig_file, test, **label)
        save_run(measured, run)
        for doubt in measured.doubts:
            say(f"doubt: {doubt}", err=True)
        say(run)

    for_each(tables[:1] if join else tables, make_run)
