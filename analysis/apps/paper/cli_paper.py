from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from analysis.cli import completion
from analysis.cli.commands import app, command
from analysis.cli.console import say, say_json
from analysis.cli.options import AsJson


@command(app, "rig paper --plot figures")
def paper(
    as_json: AsJson = False,
    plot: Annotated[
        Path | None,
        typer.Option(help="Directory for the data figures of the paper; default: none."),
    ] = None,
    rig_file: Annotated[
        str,
        typer.Option(
            "--rig", autocompletion=completion.rig_files, help="Rig file, or the name of a shipped rig, to simulate."
        ),
    ] = "paper-errors",
) -> None:
    """Simulate and evaluate the tests of the paper, and compare the figures with the published ones."""

    from analysis.apps.paper.rows import as_object, paper_answer, rows_of
    from analysis.apps.report.blocks import say_answer
    from analysis.cli.console import progress_of
    from rigs.load import load

    rig, text = load(rig_file)
    with progress_of("simulating and evaluating the tests of the paper"):
        rows = rows_of(rig)
    if plot:
        from analysis.apps.paper.pictures import save

        with progress_of("drawing the figures"):
            figures = list(save(rig, text, rows, plot))
        for path in figures:
            say(path, err=True)
    if as_json:
        say_json(as_object(rig, rows))
    else:
        say_answer(paper_answer(rig, rows))
