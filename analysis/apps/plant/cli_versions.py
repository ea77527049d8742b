"""`rig versions RIG`: list and restore calibrations of a robot."""

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
        typer.Option("--in", metavar="FOLDER", help="Folder of the versions; default: the folder of the rig file."),
    ] = None,
    back_to: Annotated[
        Path | None,
        typer.Option(
            metavar="RIG", help="Version that replaces the rig file; the old rig file is kept; default: none."
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """List the calibrations of a robot, newest first, or restore an earlier one.

    Use rig compare to see the differences between two calibrations.
    """
    from analysis.apps.plant.versions import roll_back, versions_answer
    from analysis.apps.plant.versions import versions as versions_in
    from analysis.apps.report.blocks import say_answer

    if back_to is not None:
        kept, differing = roll_back(rig_file, back_to, dt.datetime.now(dt.UTC))
        say(f"{rig_file} now contains {back_to}; the previous file is kept as {kept}")
        if differing:
            which = f"this also changed other keys of the rig file: {', '.join(differing)}"
            say(f"{which}; compare with {kept.name}", err=True, mark="note: ")
        say("next: repeat the correction of targets and programs: rig correct", err=True)
        return
    versions_here = versions_in(rig_file, folder or rig_file.parent)
    if as_json:
        say_json({"versions": [version.to_dict() for version in versions_here]})
        return
    say_answer(versions_answer(versions_here))
    if others := [version for version in versions_here if not version.in_use]:
        say(f"next: rig compare {as_argument(rig_file)} {as_argument(others[0].path)}", err=True)
