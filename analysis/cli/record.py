"""`rig record start|stop`, `rig status`, `rig metrics` and `rig automatic`."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Annotated, Literal

import typer

from analysis.cli import completion
from analysis.cli.commands import CommandGroup, app, command
from analysis.cli.console import say, say_json
from analysis.cli.options import AsJson, Operator, direction_option, operator_or_user
from rigs.errors import RigError
from rigs.schema.vocabulary import Direction, TestName
from rigs.text import as_argument

record = typer.Typer(cls=CommandGroup, no_args_is_help=True, help="Start and stop a recording of the running daemon.")
app.add_typer(record, name="record")

_MOST_ROWS = 2_000_000
"""Maximum number of rows of a run that is checked when the recording stops, which takes a second."""

RigName = Annotated[
    str | None,
    typer.Option(
        "--rig", autocompletion=completion.daemons, help="Name of the rig; default: the only daemon that runs."
    ),
]


@command(record, "rig record start lap-acw --test yaw --direction acw")
def start(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the run: letters, digits, . _ and -.")],
    test: Annotated[TestName, typer.Option(help="Test that the robot will drive.")],
    direction: Annotated[
        Direction | None, direction_option("Direction of the circle, required for yaw and roll; default: none")
    ] = None,
    operator: Operator = "",
    placement: Annotated[str, typer.Option(help="Label of the place of instrument or ball; default: none.")] = "",
    corrected: Annotated[
        Literal["targets", "entries"] | None,
        typer.Option(
            help="Active correction: corrected targets of a program, or values entered at the controller; "
            "default: none."
        ),
    ] = None,
    rig: RigName = None,
) -> None:
    """Start a recording and print the run directory."""
    from daq.service.client import Client, find_socket

    with Client(find_socket(rig)) as client:
        fields = {
            "name": name,
            "test": test,
            "direction": direction,
            "operator": operator_or_user(operator),
            "placement": placement,
            "corrected": corrected or "",
        }
        say(client.ask("record_start", **fields)["run"])


@command(record, "rig record stop")
def stop(rig: RigName = None) -> None:
    """Stop the recording and print the run directory.

    Standard error shows faults, the seal, whether the robot was still moving,
    and the reason if rig analyse would reject the run.
    """
    from analysis.procedures.results import fitness
    from daq.service.client import Client, find_socket

    with Client(find_socket(rig)) as client:
        ended = client.ask("record_stop")
        say(ended["run"])
        for stream, counters in ended["counters"].items():
            faults = [f"{count} {kind}" for kind, count in counters.items() if kind != "samples"]
            if faults:
                say(f"{stream}: {', '.join(faults)} while recording", err=True)
        if seal := ended.get("seal"):
            say(f"seal: {seal}", err=True)
        rows = sum(counters.get("samples", 0) for counters in ended["counters"].values())
        if rows > _MOST_ROWS:
            return
        found, remedy = fitness(Path(ended["run"])), "repeat the run"
        if found.still_driving:
            say("the robot was still moving when the recording ended: the rest of the motion is not recorded", err=True)
            remedy = "stop the next recording after the robot has been at rest for 3 s"
        if found.why:
            if found.drove:
                remedy = f"correct the label: rig relabel {as_argument(ended['run'])} --direction {found.drove}"
            say(f"cannot be analysed: {found.why}; {remedy}", err=True)
            with suppress(RigError):  # the daemon is older or has stopped
                client.ask("judged", run=ended["run"], said=found.why)


@command(app, "rig status")
def status(rig: RigName = None, as_json: AsJson = False) -> None:
    """Show the current readings and recording of the daemon."""

    from daq.service.client import Client, find_socket

    with Client(find_socket(rig)) as client:
        state = client.ask("status")
    if as_json:
        say_json(state)
        return

    from analysis.cli.daemon_screen import screen
    from analysis.cli.plain_console import PlainConsole

    PlainConsole().print(screen(state))


@command(app, "rig metrics --rig cell")
def metrics(rig: RigName = None) -> None:
    """Print rates, faults, queues, disk and clocks of the daemon in the text format of Prometheus."""
    from daq.service.client import Client, find_socket

    with Client(find_socket(rig)) as client:
        for line in client.ask("metrics")["text"].splitlines():
            say(line)


@command(app, "rig automatic runs/lap-acw runs/lap-cw >> cell.yaml")
def automatic(
    paths: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN…", autocompletion=completion.runs, help="Run directories as recorded, one per program."
        ),
    ],
) -> None:
    """Print the section `automatic` of a rig file, which starts runs like these on a robot signal or motion."""
    import yaml
    from pydantic import ValidationError

    from analysis.runs.recording_rule import rule_of
    from daq.store import read_run
    from rigs.errors import FileError
    from rigs.schema.declared_tests import Automatic

    rules = [rule_of(read_run(path)) for path in paths]
    try:
        Automatic(rules=tuple(rules))
    except ValidationError as error:
        where, problem = ", ".join(map(str, paths)), error.errors(include_url=False)[0]["msg"]
        remedy = "give one run of each program"
        raise FileError(where, problem.removeprefix("Value error, "), remedy, code="rig_file.invalid") from None
    say("automatic:")
    say("  rules:")
    for rule in rules:
        keys = rule.model_dump(mode="json", exclude_none=True)
        line = yaml.safe_dump(keys, default_flow_style=True, sort_keys=False, width=10_000)
        say(f"    - {line.strip()}")
