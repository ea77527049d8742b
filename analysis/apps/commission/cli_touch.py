"""`rig record touch`: records touches of a ball in sockets in sequence, using the running daemon."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from analysis.cli.commands import command
from analysis.cli.console import say
from analysis.cli.options import Operator, operator_or_user
from analysis.cli.record import RigName, record


@command(record, "rig record touch monday --output runs/monday-touch")
def touch(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the run: letters, digits, . _ and -.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Run directory to create.")],
    touches: Annotated[
        int | None, typer.Option(min=6, max=2000, help="Touches of all sockets; default: the number in the rig file.")
    ] = None,
    operator: Operator = "",
    placement: Annotated[str, typer.Option(help="Label of the place of the sockets; default: none.")] = "",
    rig: RigName = None,
) -> None:
    """Guide through touches: seat the ball, let go, wait for the tone, and go to the next posture.

    The robot is guided by hand or by its program. Ctrl-C ends early and keeps what was touched.
    """
    from analysis.apps.commission.record_touches import record_touches
    from daq.service.client import Client, find_socket

    with Client(find_socket(rig)) as client:
        run = record_touches(client, name, output, operator_or_user(operator), placement, touches, say)
    say(run)
