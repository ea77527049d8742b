"""`rig example DIR`: the shipped rig files, to start from."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from shutil import copyfileobj
from typing import Annotated

import typer

from analysis.cli import app
from analysis.cli.commands import command
from analysis.cli.console import say


@command(app, "rig example rigs")
def example(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="Directory for the files; it is created if it does not exist.")
    ],
) -> None:
    """Write the shipped rig files, and what their emulated cells hide, into a directory: copies to start from."""
    from analysis.files.write import write_new  # noqa: PLC0415
    from rigs.errors import FileError  # noqa: PLC0415
    from rigs.load import shipped, shipped_effects  # noqa: PLC0415

    sources = [*shipped().values(), *shipped_effects().values()]
    if taken := next((folder / file.name for file in sources if (folder / file.name).exists()), None):
        raise FileError(str(taken), "exists already", "choose another directory, or remove the file first")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(str(folder), error.strerror or str(error), "choose another directory") from None
    for source in sources:
        with source.open("rb") as original:
            write_new(folder / source.name, partial(copyfileobj, original))
        say(str(folder / source.name))
