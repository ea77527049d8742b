"""`rig automatic RUN…`: rules by which the daemon will know recorded programs again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from analysis.cli import completion
from analysis.cli.commands import app, command
from analysis.cli.console import say


@command(app, "rig automatic runs/lap-acw runs/lap-cw >> cell.yaml")
def automatic(
    paths: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN…", autocompletion=completion.runs, help="Run directories as recorded, one for each program."
        ),
    ],
) -> None:
    """Print the section `automatic` of a rig file, by which the robot's signal or motion starts runs like these."""
    import yaml
    from pydantic import ValidationError

    from analysis.traces.recording_rule import rule_of
    from daq.store import read_run
    from rigs.errors import FileError
    from rigs.schema.declared_tests import Automatic

    rules = [rule_of(read_run(path)) for path in paths]
    try:
        Automatic(rules=tuple(rules))
    except ValidationError as error:
        problem = error.errors(include_url=False)[0]["msg"].removeprefix("Value error, ")
        raise FileError(", ".join(map(str, paths)), problem, "give one run of each program") from None
    say("automatic:")
    say("  rules:")
    for rule in rules:
        line = yaml.safe_dump(
            rule.model_dump(mode="json", exclude_none=True), default_flow_style=True, sort_keys=False, width=10_000
        )
        say(f"    - {line.strip()}")
