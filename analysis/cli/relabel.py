"""`rig relabel RUN`: a run that was recorded under the wrong label."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from analysis.cli import app
from analysis.cli.console import say
from rigs.schema.vocabulary import Direction


@app.command()
def relabel(
    paths: Annotated[list[Path], typer.Argument(metavar="RUN", help="Run directories.")],
    test: Annotated[
        Literal["yaw", "roll", "radial", "repeatability"] | None, typer.Option(help="What the robot did.")
    ] = None,
    direction: Annotated[Direction | None, typer.Option(help="Of a circle.")] = None,
    operator: Annotated[str | None, typer.Option(help="Who measured.")] = None,
    placement: Annotated[
        str | None, typer.Option(help="Where instrument or ball stood, by a name of yours; '' takes it back.")
    ] = None,
) -> None:
    """Correct the label of runs that were recorded under the wrong one; their manifests keep the old words."""
    from daq.store import relabel as relabel_run  # noqa: PLC0415

    if test is None and direction is None and operator is None and placement is None:
        raise typer.BadParameter("give --test, --direction, --operator or --placement")
    for path in paths:
        manifest = relabel_run(path, test=test, direction=direction, operator=operator, placement=placement)
        words = " ".join(filter(None, (manifest.test, manifest.direction)))
        place = f" at {manifest.placement}" if manifest.placement else ""
        say(f"{path}: {words}{place}, measured by {manifest.operator or 'nobody named'}")
