"""`rig moved REFERENCE… NEW`: movements between a reference and new readings, and the next touch."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from analysis.cli import completion
from analysis.cli.commands import app, command, taking_all
from analysis.cli.console import say, say_json, say_written
from analysis.cli.options import AsJson, Language, ModelRig, RobotRunsBelow, location, operator_or_user
from rigs.errors import FileError, UseError
from rigs.text import as_argument

if TYPE_CHECKING:
    from analysis import Measured
    from analysis.apps.commission.what_moved import MovementResult


@command(app, "rig moved runs/before-* --new runs/after-*", cls=taking_all("--new"))
def moved(
    runs: RobotRunsBelow,
    new: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="RUN…",
            parser=location,
            autocompletion=completion.runs,
            help="Runs after a possible movement; default: the last run of RUN…, and none with --plan and --live.",
        ),
    ] = None,
    rig_file: ModelRig = None,
    plan: Annotated[
        bool, typer.Option("--plan", help="Choose the next touch: the one that separates the remaining causes best.")
    ] = False,
    live: Annotated[
        bool,
        typer.Option(
            "--live", help="Guide through the touches with the running daemon until a cause is named, and save them."
        ),
    ] = False,
    save: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="With --live: run directory to create; default: moved-DATE beside the reference."
        ),
    ] = None,
    mark: Annotated[
        bool, typer.Option("--mark", help="Store the answer with the new runs, so that rig history shows the day.")
    ] = False,
    lang: Language = "en",
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE.html", help="Page to write; default: none.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Report what moved since a reference: base, socket, tool, a joint's zero, nothing, or something else.

    RUN… are reference runs of touches, poses or circles. A few new
    readings of the same sockets or targets are enough."""
    from analysis.apps.commission.movement_report import movement_answer, write_page
    from analysis.apps.report.blocks import say_answer
    from analysis.apps.report.html_page import check_page_file
    from analysis.apps.report.texts import texts_of

    if output:
        check_page_file(output)
    if live:
        for option, is_given in (("--new", new), ("--plan", plan), ("--mark", mark)):
            if is_given:
                problem = "has no effect with --live, because --live takes and saves the touches"
                raise UseError(option, problem, "leave it out")
        found, title = _check_live(runs, rig_file, save, is_quiet=as_json)
    elif save:
        problem = "is the run of the touches that --live takes"
        raise UseError("--save", problem, "add --live, or leave it out")
    else:
        found, title = _find_movement(runs, new or [], rig_file, plan=plan, mark=mark)
    if as_json:
        say_json(found.to_dict())
    else:
        say_answer(movement_answer(found, texts_of(lang)))
    if output:
        write_page(found, output, title, lang)
        say_written([output])


def _read(paths: Sequence[Path], rig_file: str | None) -> list[Measured]:
    from analysis.cli.several import end_with, load_runs, runs_below, with_tables, worst_code

    runs, errors = load_runs([run.resolve() for run in runs_below(with_tables(paths, rig_file))])
    end_with(worst_code(errors))
    return runs


def _find_movement(
    runs: list[Path], new: list[Path], rig_file: str | None, *, plan: bool, mark: bool
) -> tuple[MovementResult, str]:
    from analysis.apps.commission.what_moved import what_moved_in
    from analysis.cli.console import progress_of
    from rigs.load import load

    if not new and not plan:
        if len(runs) < 2:
            remedy = "give RUN… --new RUN…, --plan or --live"
            raise UseError("rig moved", "needs a reference and a new run", remedy, code="usage")
        runs, new = runs[:-1], runs[-1:]
    reference, after = _read(runs, rig_file), _read(new, rig_file)
    rig = load(rig_file)[0] if rig_file else reference[0].rig
    with progress_of("comparing the readings"):
        found = what_moved_in(rig, reference, after, plan=plan)
    if mark:
        _mark(found, reference, after, new)
    return found, rig.name


def _mark(
    result: MovementResult, reference: Sequence[Measured], after: Sequence[Measured], paths: Sequence[Path]
) -> None:
    from analysis.apps.commission.guided_touches import mark_of
    from daq.store import mark_moved

    if not after or any(path.is_file() for path in paths):
        problem = "needs new runs; tables are not stored as runs"
        raise UseError("--mark", problem, "import the table first: rig import", code="usage")
    names = [run.run.manifest.name for run in reference]
    for run in after:
        mark_moved(run.run.path, mark_of(result, names))


def _check_live(
    runs: list[Path], rig_file: str | None, save: Path | None, *, is_quiet: bool
) -> tuple[MovementResult, str]:
    from analysis.apps.commission.guided_touches import GuidedCheck, follow_touches
    from analysis.runs.written_files import refuse_existing
    from daq import clock
    from daq.service.client import Client, find_socket
    from rigs.load import load

    reference = _read(runs, rig_file)
    first = reference[0].run.path
    beside = first.parent if first.is_dir() else Path("runs")
    place = save or beside / f"moved-{clock.wall_time().astimezone():%Y%m%d-%H%M%S}"
    refuse_existing(place)
    rig = load(rig_file)[0] if rig_file else None
    check = GuidedCheck.of_runs(reference, rig)
    with Client(find_socket(check.rig.name)) as client:
        check = follow_touches(client, check, lambda line: say(line, err=is_quiet))
    if not check.touches:
        remedy = "seat the ball in a socket of the reference, then let go"
        raise FileError(str(place), "no touch was taken", remedy, code="readings.too_few")
    check.save(place, operator_or_user(""))
    say(f"saved {place}", err=True)
    say(f"next: rig history {as_argument(check.rig.name)} --runs {as_argument(place.parent)}", err=True)
    return check.result, check.rig.name
