"""`rig versions RIG`: the calibrations of a robot, and going back to one."""

from __future__ import annotations

import datetime as dt
from pathlib import Path
from typing import Annotated

import typer

from analysis.cli.commands import app, command
from analysis.cli.console import say, say_json
from analysis.cli.options import AsJson
from rigs.text import as_argument


@command(app, "rig versions cell.yaml --back-to found-march/cell.yaml")
def versions(
    rig_file: Annotated[Path, typer.Argument(metavar="RIG", help="Rig file that is in use.")],
    folder: Annotated[
        Path | None,
        typer.Option("--in", metavar="FOLDER", help="Folder that holds the versions; default: that of the rig file."),
    ] = None,
    back_to: Annotated[
        Path | None,
        typer.Option(metavar="RIG", help="Version that takes the place of the rig file, which is kept; default: none."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """List the calibrations of a robot, the newest first, or go back to one; rig compare shows how two differ."""
    from analysis.files.versions import roll_back
    from analysis.files.versions import versions as versions_in
    from analysis.reporting.listings import version_object, versions_table
    from analysis.reporting.plain_console import PlainConsole

    if back_to is not None:
        done = roll_back(rig_file, back_to, dt.datetime.now(dt.UTC))
        say(f"{rig_file} is {back_to} now; what it was is {done.kept}")
        if done.differing:
            which = f"beside the calibration {', '.join(done.differing)} are those of {back_to} now"
            say(f"{which}; compare them with {done.kept.name}", err=True, mark="note: ")
        say("next: correct the robot's targets and programs again: rig correct", err=True)
        return
    versions_here = versions_in(rig_file, folder or rig_file.parent)
    if as_json:
        say_json({"versions": [version_object(version) for version in versions_here]})
        return
    PlainConsole().print(versions_table(versions_here))
    if others := [version for version in versions_here if not version.in_use]:
        say(f"next: rig compare {as_argument(rig_file)} {as_argument(others[0].path)}", err=True)
