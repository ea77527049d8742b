"""`rig plan RIG`: before any measurement, which effects a set of tests can detect and distinguish."""

from __future__ import annotations

from typing import Annotated

import typer

from analysis.cli import app
from analysis.cli.commands import command
from analysis.cli.console import say_json
from analysis.cli.options import AsJson, RigArgument

_LEAST_COLUMNS = 80


@command(app, "rig plan cell.yaml --tests yaw,radial --runs 5")
def plan(
    rig_file: RigArgument,
    tests: Annotated[
        str | None,
        typer.Option(help="Tests, separated by commas: yaw, roll, radial, repeatability; default: the first three."),
    ] = None,
    runs: Annotated[
        int, typer.Option(min=1, max=1000, help="Number of runs of each test, for circles in each direction.")
    ] = 3,
    as_json: AsJson = False,
) -> None:
    """Report which effects the tests can detect and distinguish, from which size on, and which test adds the most."""

    from analysis.cli.progress import progress_of  # noqa: PLC0415
    from analysis.diagnosis.plan import plan as planned  # noqa: PLC0415
    from analysis.diagnosis.plan import tests_named  # noqa: PLC0415
    from analysis.reporting import plan_report  # noqa: PLC0415
    from analysis.reporting.plain_console import PlainConsole  # noqa: PLC0415
    from rigs.load import load  # noqa: PLC0415

    rig, _ = load(rig_file)
    with progress_of("simulating the tests"):
        found = planned(rig, tests_named(rig, tests), runs)
    if as_json:
        say_json(plan_report.as_object(found))
    else:
        # Narrower, sizes would be broken in two, and half of one reads like another.
        PlainConsole(width=max(_LEAST_COLUMNS, PlainConsole().width)).print(plan_report.as_table(found))
