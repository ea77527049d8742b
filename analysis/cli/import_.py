"""`rig import TABLE…`: runs from tables of other programs and from ROS 2 bags."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from analysis.cli.commands import app, command
from analysis.cli.console import say
from analysis.cli.options import Calibration, Operator, direction_option, operator_or_user, rig_option
from analysis.cli.several import for_each, with_controller
from analysis.runs.table_format import format_of
from analysis.runs.table_layout import SOCKET, JointSource
from rigs.errors import UseError
from rigs.schema.vocabulary import CIRCLES, Direction, TestName


@command(app, "rig import laps.csv --rig cell.yaml --test yaw -o runs/lap-acw", name="import")
def import_(
    tables: Annotated[
        list[Path], typer.Argument(metavar="TABLE…", help="CSV files, workbooks, or bags of ROS 2: docs/tables.md.")
    ],
    rig_file: Annotated[str, rig_option("Rig file, or the name of a shipped rig or of an arm in the library.")],
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            help="Run directory to create; with several tables: directory in which each run gets the name of its "
            "table.",
        ),
    ],
    calibration: Calibration = None,
    test: Annotated[TestName | None, typer.Option(help="Test of the tables; default: by their columns.")] = None,
    direction: Annotated[
        Direction | None, direction_option("Direction of yaw and roll; default: the column direction of the table")
    ] = None,
    operator: Operator = "",
    placement: Annotated[str, typer.Option(help="Label of the place of instrument or ball; default: none.")] = "",
    joints: Annotated[
        JointSource, typer.Option(help="Joint angles to use: columns qN_deg, or qN_commanded_deg.")
    ] = "measured",
    map_file: Annotated[
        Path | None, typer.Option("--map", help="Map of the columns; default: proposed by rig if needed.")
    ] = None,
    join: Annotated[
        str,
        typer.Option(
            metavar="rows|COLUMN",
            help="The files are one measurement, joined row by row or by a column; default: a run of each file.",
        ),
    ] = "",
    socket: Annotated[
        str, typer.Option(help="With --test touch: socket that all rows touch; default: the column socket.")
    ] = "",
    topic: Annotated[
        str,
        typer.Option(help="Topic of the poses in a bag, of a transform /tf:CHILD; default: the only topic of poses."),
    ] = "",
    yes: Annotated[
        bool,
        typer.Option(
            "--yes",
            help="Take the likeliest answer to each open question about a table; each becomes a doubt of the run.",
        ),
    ] = False,
) -> None:
    """Create a run from each table of measurements; report every bad row with its line and the reason.

    Tables of poses may have the format of the instrument: rig proposes a map of
    the columns, checks it with the arm of the rig file, shows it and stores it
    in the run. You answer open questions at the terminal. If there is none, rig
    writes the map for you to complete and imports nothing.
    """
    from analysis import read_table, save_run
    from analysis.cli.console import progress_of
    from analysis.cli.import_map import mapped_run, needs_map
    from analysis.intake.readers import file_of
    from analysis.intake.touch_map import refuse_two_arms
    from analysis.runs.written_files import refuse_existing

    operator = operator_or_user(operator)
    rig_file = with_controller(rig_file, calibration)
    if test:
        _refuse_other_options(test, direction, topic, socket)

    def make_run(table: Path) -> None:
        files = [file_of(source) for source in (tables if join else [table])]
        run = output / table.stem if len(tables) > 1 and not join else output
        refuse_existing(run)
        kind = test or _by_its_columns(files[0], rig_file)
        _refuse_other_options(kind, direction, topic, socket)
        refuse_two_arms(files[0], kind)
        label: Any = {"direction": direction, "operator": operator, "placement": placement, "joints": joints}
        if join or map_file or needs_map(files[0], kind, socket):
            asked: Any = {"map_file": map_file, "join": join, "yes": yes, "topic": topic, "socket": socket}
            measured = mapped_run(files, rig_file, kind, run, **asked, **label)
        else:
            with progress_of(f"reading {table}"):
                measured = read_table(files[0], rig_file, kind, **label)
        save_run(measured, run)
        for doubt in measured.doubts:
            say(f"doubt: {doubt}", err=True)
        say(run)

    for_each(tables[:1] if join else tables, make_run)


def _by_its_columns(table: Path, rig_file: str) -> TestName:
    from analysis.intake.imports import test_of
    from rigs.load import load

    test = test_of(table, load(rig_file)[0])
    say(f"{table}: a {test} table according to the columns; --test overrides this", err=True)
    return test


def _refuse_other_options(test: TestName, direction: Direction | None, topic: str, socket: str) -> None:
    """Raise UseError for an option that does not apply to a test."""
    from analysis.intake.table_map import MAPPED

    if direction and test not in CIRCLES:
        raise UseError(
            "--direction", f"a {test} test does not have a direction", "remove it", code="import.option_unused"
        )
    if socket and SOCKET not in format_of(test).layout().required:
        raise UseError("--socket", f"is of touches, and the test is {test}", "remove it", code="import.option_unused")
    if topic and test != MAPPED:
        raise UseError("--topic", f"is of poses, and the test is {test}", "remove it", code="import.option_unused")
