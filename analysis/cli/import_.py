"""`rig import TABLE…`: tables of measurements from elsewhere, and bags of ROS 2, as runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from analysis.cli import app, completion
from analysis.cli.commands import command
from analysis.cli.console import say
from analysis.cli.options import direction_option, operator_or_user
from analysis.cli.several import for_each
from analysis.traces.table_layout import JointSource
from rigs.errors import UseError
from rigs.schema.vocabulary import CIRCLES, Direction, TestName


@command(app, "rig import laps.csv --rig cell.yaml --test yaw -o runs/lap-acw", name="import")
def import_(
    tables: Annotated[
        list[Path],
        typer.Argument(metavar="TABLE…", help="CSV files with the columns of docs/tables.md, or MCAP bags of ROS 2."),
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
) -> None:
    """Create a run from each table of measurements; every bad row is reported with its line and the reason."""
    from analysis import read_table, save_run  # noqa: PLC0415
    from analysis.cli.progress import progress_of  # noqa: PLC0415
    from rigs.errors import FileError  # noqa: PLC0415

    if direction and test not in CIRCLES:
        raise UseError("--direction", f"a {test} test has no direction", "leave it out")
    operator = operator_or_user(operator)

    def make_run(table: Path) -> None:
        run = output / table.stem if len(tables) > 1 else output
        if run.exists():
            raise FileError(str(run), "exists already", "give the run a directory of its own")
        with progress_of(f"reading {table}"):
            measured = read_table(
                table, rig_file, test, direction, operator=operator, placement=placement, joints=joints
            )
            save_run(measured, run)
        for doubt in measured.doubts:
            say(f"doubt: {doubt}", err=True)
        say(run)

    for_each(tables, make_run)
