"""`rig example DIR`: the shipped rig files, to start from."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from analysis.cli.commands import app, command
from analysis.cli.console import say


@command(app, "rig example rigs")
def example(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="Directory for the files; it is created if it does not exist.")
    ],
) -> None:
    """Write the shipped rig files, and what their emulated cells hide, into a directory: copies to start from."""
    from analysis.files.write import holding, write_all_new
    from rigs.load import shipped, shipped_effects

    sources = [*shipped().values(), *shipped_effects().values()]
    for path in write_all_new(folder, {source.name: holding(source.read_bytes()) for source in sources}):
        say(str(path))
