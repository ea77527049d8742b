"""`rig record start|stop`, `rig status` and `rig metrics`: asking the running daemon."""

from __future__ import annotations

from typing import Annotated

import typer

from analysis.cli import app
from analysis.cli.console import say, say_json
from rigs.schema.vocabulary import Direction, TestName

record = typer.Typer(no_args_is_help=True, help="Start and stop a recording of the running daemon.")
app.add_typer(record, name="record")

RigName = Annotated[str | None, typer.Option("--rig", help="Which daemon, where several run.")]


@record.command()
def start(
    name: Annotated[str, typer.Argument(metavar="NAME", help="What to call the run: letters, digits, . _ and -.")],
    test: Annotated[TestName, typer.Option(help="What the robot is going to do.")],
    direction: Annotated[Direction | None, typer.Option(help="Of a circle.")] = None,
    operator: Annotated[str, typer.Option(help="Who measures; without it, the user.")] = "",
    placement: Annotated[str, typer.Option(help="Where instrument or ball stand, by a name of yours.")] = "",
    rig: RigName = None,
) -> None:
    """Begin a recording; prints the run directory."""
    import getpass  # noqa: PLC0415

    from daq.service.client import Client, find_socket  # noqa: PLC0415

    with Client(find_socket(rig)) as client:
        fields = {
            "name": name,
            "test": test,
            "direction": direction,
            "operator": operator or getpass.getuser(),
            "placement": placement,
        }
        say(client.ask("record_start", **fields)["run"])


@record.command()
def stop(rig: RigName = None) -> None:
    """End the recording; prints the run directory, and on standard error what went wrong meanwhile."""
    from daq.service.client import Client, find_socket  # noqa: PLC0415

    with Client(find_socket(rig)) as client:
        ended = client.ask("record_stop")
    say(ended["run"])
    for stream, counters in ended["counters"].items():
        faults = [f"{count} {kind}" for kind, count in counters.items() if kind != "samples"]
        if faults:
            say(f"{stream}: {', '.join(faults)} while recording", err=True)


@app.command()
def status(
    rig: RigName = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """What the daemon reads and records now."""

    from daq.service.client import Client, find_socket  # noqa: PLC0415

    with Client(find_socket(rig)) as client:
        state = client.ask("status")
    if as_json:
        say_json(state)
        return

    from analysis.reporting.daemon_screen import screen  # noqa: PLC0415
    from analysis.reporting.plain_console import PlainConsole  # noqa: PLC0415

    PlainConsole().print(screen(state))


@app.command()
def metrics(rig: RigName = None) -> None:
    """The daemon's rates, faults, queues, disk and clocks in the text format of Prometheus."""
    from daq.service.client import Client, find_socket  # noqa: PLC0415

    with Client(find_socket(rig)) as client:
        for line in client.ask("metrics")["text"].splitlines():
            say(line)
