"""`rig import TABLE`: a table of measurements from elsewhere as a run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from analysis.cli import app
from analysis.traces.table_layout import JointSource
from rigs.schema.vocabulary import Direction, TestName


@app.command("import")
def import_(
    table: Annotated[Path, typer.Argument(metavar="TABLE", help="CSV file with the columns of docs/tables.md.")],
    rig_file: Annotated[str, typer.Option("--rig", help="Rig file, or the name of a shipped rig.")],
    test: Annotated[TestName, typer.Option(help="What was measured.")],
    run: Annotated[Path, typer.Option("--output", "-o", help="The run directory to make.")],
    direction: Annotated[
        Direction | None, typer.Option(help="Of a circle whose table has no direction column.")
    ] = None,
    operator: Annotated[str, typer.Option(help="Who measured; without it, the user.")] = "",
    placement: Annotated[str, typer.Option(help="Where instrument or ball stood, by a name of yours.")] = "",
    joints: Annotated[
        JointSource, typer.Option(help="Which are the robot's: columns qN_deg, or qN_commanded_deg.")
    ] = "measured",
) -> None:
    """Make a run of a table of measurements; every bad row is named with its line and the reason."""
    import getpass  # noqa: PLC0415

    from analysis import read_table, save_run  # noqa: PLC0415
    from rigs.errors import FileError  # noqa: PLC0415

    if run.exists():
        raise FileError(str(run), "is there already", "give the run a directory of its own")
    operator = operator or getpass.getuser()
    measured = read_table(table, rig_file, test, direction, operator=operator, placement=placement, joints=joints)
    save_run(measured, run)
    for doubt in measured.doubts:
        typer.echo(f"doubt: {doubt}", err=True)
    typer.echo(run)
