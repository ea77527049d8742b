"""`rig versions RIG`: list and restore calibrations of a robot."""

from __future__ import annotations

import datetime as dt
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from analysis.cli.commands import app, command
from analysis.cli.console import say, say_json
from analysis.cli.options import AsJson
from rigs.text import as_argument, plain

if TYPE_CHECKING:
    from rich.console import RenderableType

    from analysis.apps.plant.versions import Version


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
    from analysis.apps.plant.versions import roll_back
    from analysis.apps.plant.versions import versions as versions_in
    from analysis.cli.plain_console import PlainConsole

    if back_to is not None:
        done = roll_back(rig_file, back_to, dt.datetime.now(dt.UTC))
        say(f"{rig_file} now contains {back_to}; the previous file is kept as {done.kept}")
        if done.differing:
            which = f"this also changed other keys of the rig file: {', '.join(done.differing)}"
            say(f"{which}; compare with {done.kept.name}", err=True, mark="note: ")
        say("next: repeat the correction of targets and programs: rig correct", err=True)
        return
    versions_here = versions_in(rig_file, folder or rig_file.parent)
    if as_json:
        say_json({"versions": [version.to_dict() for version in versions_here]})
        return
    PlainConsole().print(versions_table(versions_here))
    if others := [version for version in versions_here if not version.in_use]:
        say(f"next: rig compare {as_argument(rig_file)} {as_argument(others[0].path)}", err=True)


def versions_table(versions: Sequence[Version]) -> RenderableType:
    """Return a row for each calibration, newest first."""
    from rich.table import Table
    from rich.text import Text

    from analysis.cli.plain_console import right
    from rigs.calibration import verdict_of

    if not versions:
        return Text("This directory has no calibration of this robot. To write one: rig diagnose RUN… -o DIRECTORY")
    numbers = map(right, ("runs", "before µm", "calibrated µm", "left out µm", "to correct by"))
    table = Table("", "date", "rig file", *numbers, header_style="bold")
    for version in versions:
        model = version.calibrated
        left_out = "" if model.held_out_um is None else f"{model.held_out_um:.1f}"
        figures = (f"{model.before_um:.1f}", f"{model.calibrated_um:.1f}", left_out)
        verdict = "yes" if verdict_of(model) == "correct" else "no"
        use, path = "in use" if version.in_use else "", plain(str(version.path))
        table.add_row(use, f"{model.date}", path, f"{len(model.runs)}", *figures, verdict)
    return table
