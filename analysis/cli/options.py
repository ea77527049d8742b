"""Arguments and options that several commands take, each with one meaning, one help text and one completion."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from analysis.cli import completion

Runs = Annotated[list[Path], typer.Argument(metavar="RUN…", autocompletion=completion.runs, help="Run directories.")]
RobotRuns = Annotated[
    list[Path], typer.Argument(metavar="RUN…", autocompletion=completion.runs, help="Run directories of one robot.")
]
RigArgument = Annotated[
    str,
    typer.Argument(metavar="RIG", autocompletion=completion.rig_files, help="Rig file, or the name of a shipped rig."),
]
ModelRig = Annotated[
    str | None,
    typer.Option(
        "--rig", autocompletion=completion.rig_files, help="Rig file of the model; default: that of the first run."
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")]
