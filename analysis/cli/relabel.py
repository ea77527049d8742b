"""`rig relabel RUN`: a run that was recorded under the wrong label."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from analysis.cli.commands import app, command
from analysis.cli.console import say
from analysis.cli.options import Runs, direction_option
from analysis.cli.several import for_each
from rigs.schema.vocabulary import Direction, DrivenTest


@command(app, "rig relabel runs/lap-3 --direction cw")
def relabel(
    paths: Runs,
    test: Annotated[
        DrivenTest | None,
        typer.Option(help="Test that the robot drove; default: unchanged."),
    ] = None,
    direction: Annotated[
        Direction | None, direction_option("Direction that the circle was driven in; default: unchanged")
    ] = None,
    operator: Annotated[str | None, typer.Option(help="Name of the person who measured; default: unchanged.")] = None,
    placement: Annotated[
        str | None,
        typer.Option(help="Your name for where the instrument or the ball stood, '' for none; default: unchanged."),
    ] = None,
) -> None:
    """Correct the labels of runs; their ledgers keep the old labels."""
    from daq.store import marks as relabel_run

    if test is None and direction is None and operator is None and placement is None:
        raise typer.BadParameter("give --test, --direction, --operator or --placement")

    def correct(path: Path) -> None:
        manifest = relabel_run(path, test=test, direction=direction, operator=operator, placement=placement)
        words = " ".join(filter(None, (manifest.test, manifest.direction)))
        place = f" at {manifest.placement}" if manifest.placement else ""
        say(f"{path}: {words}{place}, measured by {manifest.operator or 'an unnamed operator'}")

    for_each(paths, correct)
