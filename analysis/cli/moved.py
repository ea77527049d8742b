"""`rig moved REFERENCE… NEW`: movements between a reference and new readings, and the next touch."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from analysis.cli import completion
from analysis.cli.commands import app, command, taking_all
from analysis.cli.console import say, say_json
from analysis.cli.options import AsJson, ModelRig, RobotRunsBelow, location
from rigs.errors import UseError

if TYPE_CHECKING:
    from analysis.movement.result import MovementResult


@command(app, "rig moved runs/before-* --new runs/after-*", cls=taking_all("--new"))
def moved(
    runs: RobotRunsBelow,
    new: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="RUN…",
            parser=location,
            autocompletion=completion.runs,
            help="Runs after a possible movement; default: the last run of RUN…, and none with --plan.",
        ),
    ] = None,
    rig_file: ModelRig = None,
    plan: Annotated[
        bool, typer.Option("--plan", help="Choose the next touch: the one that separates the remaining causes best.")
    ] = False,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE.html", help="Page to write; default: none.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Report what moved since a reference: base, socket, tool, a joint's zero, nothing, or something else.

    RUN… are reference runs of touches, poses or circles. A few new
    readings of the same sockets or targets are enough."""
    from analysis.report.html_page import check_page_file
    from analysis.report.movement_report import as_screen, write_page
    from analysis.report.plain_console import PlainConsole

    if output:
        check_page_file(output)
    found, title = _find_movement(runs, new or [], rig_file, plan=plan)
    if as_json:
        say_json(found.to_dict())
    else:
        PlainConsole().print(as_screen(found))
    if output:
        write_page(found, output, title)
        say(f"wrote {output}", err=True)


def _find_movement(
    runs: list[Path], new: list[Path], rig_file: str | None, *, plan: bool
) -> tuple[MovementResult, str]:
    """Return the result and the name of the rig."""
    from analysis.cli.console import progress_of
    from analysis.cli.several import distinct, end_with, load_runs, runs_below, with_tables, worst
    from analysis.movement.runs import what_moved_in
    from rigs.load import load

    if not new and not plan:
        if len(runs) < 2:
            raise UseError("rig moved", "needs a reference and a new run", "give RUN… --new RUN…, or --plan")
        runs, new = runs[:-1], runs[-1:]
    (reference, errors), (after, others) = (
        load_runs(distinct(runs_below(with_tables(paths, rig_file)))) for paths in (runs, new)
    )
    end_with(worst([*errors, *others]))
    rig = load(rig_file)[0] if rig_file else reference[0].rig
    with progress_of("comparing the readings"):
        return what_moved_in(rig, reference, after, plan=plan), rig.name
