"""`rig runs`, `rig keep`, `rig relabel`, `rig recover`, `rig verify`: list, keep, label and check runs."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from analysis.cli.commands import app, command
from analysis.cli.console import say, say_json
from analysis.cli.options import Jobs, Runs, RunsBelow, Scheduler, direction_option
from analysis.cli.several import end_with, for_each, over_runs, worst_code
from rigs.schema.vocabulary import Direction, DrivenTest

if TYPE_CHECKING:
    from daq.store import VerificationResult


@command(app, "rig runs /var/lib/rigd-cell/runs")
def runs(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="Directory of the runs.")] = Path("runs"),
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON list instead of text.")] = False,
) -> None:
    """List runs with size, age, date of export and keep mark."""
    import time

    from analysis.cli.console import progress_of
    from analysis.cli.listings import run_row, runs_table
    from daq.store import survey

    denied: list[Path] = []
    with progress_of():
        rows = [run_row(run, time.time()) for run in survey(directory, denied.append)]
    for path in denied:
        say(f"{path}: not listed: this user lacks read permission", err=True)
    if as_json:
        say_json(rows)
        return
    if not rows and not denied:
        below = next(filter(_holds_runs, sorted(directory.iterdir())), None)
        say(f"{directory} does not contain runs" + (f"; {below} does: rig runs {below}" if below else ""))
        return
    if not rows:
        return
    from analysis.cli.plain_console import PlainConsole

    table = runs_table(rows)
    whole = PlainConsole(width=10_000).measure(table).maximum
    # A directory split over several lines cannot be copied. Rows stay unbroken on narrow terminals.
    PlainConsole(width=max(whole, PlainConsole().width)).print(table)


def _holds_runs(directory: Path) -> bool:
    from daq.store import survey
    from rigs.errors import FileError

    with suppress(FileError, OSError):
        return directory.is_dir() and any(survey(directory))
    return False


@command(app, "rig keep runs/lap-acw runs/lap-cw")
def keep(
    paths: Runs,
    no_more: Annotated[
        bool,
        typer.Option("--not", help="Remove the mark, so that retention may delete the runs once they are exported."),
    ] = False,
) -> None:
    """Mark runs as kept: rigd never deletes them, regardless of the retention settings."""
    from daq.store import mark_kept

    def mark(path: Path) -> None:
        mark_kept(path, not no_more)
        say(f"{path}: {'no longer kept' if no_more else 'kept'}")

    for_each(paths, mark)


@command(app, "rig recover runs/lap-acw")
def recover(paths: Runs) -> None:
    """Recover interrupted runs: keep every verified batch, and report the losses."""
    for_each(paths, _recover)


def _recover(path: Path) -> None:
    from analysis.cli.console import progress_of
    from daq.store import judge
    from daq.store import recover as recover_run
    from rigs.errors import FileError
    from rigs.text import as_argument

    with progress_of(f"recovering {path}"):
        done = recover_run(path)
        verdict = judge(path)
    for stream, rows in done.rows.items():
        say(f"{stream}: {rows} rows recovered")
    for note in done.notes:
        say(note)
    for file, loss in done.losses.items():
        say(f"lost: {file}: {loss}")
    if not (verdict.end_known or done.nothing_to_do):
        say("the end was not sealed: the last rows may be missing")
    if verdict.problems:
        for line in verdict.problems:
            say(line, err=True)
        problem = "is still incomplete, and the rest is unrecoverable"
        raise FileError(str(path), problem, "see the lines above", code="run.damaged")
    say(f"{path}: nothing to do" if done.nothing_to_do else f"{path}: recovered; next: rig verify {as_argument(path)}")


@command(app, "rig verify runs --jobs auto")
def verify(
    paths: RunsBelow,
    seal: Annotated[
        str | None, typer.Option(metavar="SHA256", help="Seal that rig record stop printed; default: not compared.")
    ] = None,
    jobs: Jobs = 1,
    scheduler: Scheduler = None,
) -> None:
    """Check that runs are complete and unchanged; the exit code is 3 if anything is wrong or missing."""
    from analysis.cli.several import runs_below

    not_whole = []

    def show(verdict: VerificationResult) -> None:
        for line in verdict.lines:
            say(line, err=True)
        if seal and verdict.seal != seal.lower():
            has = f"the seal is {verdict.seal}, different from the given seal" if verdict.seal else "it has no seal"
            say(f"{verdict.path}: {has}: the run is a different run, or was interrupted and resealed", err=True)
            not_whole.append(verdict.path)
        say(verdict.summary)
        if verdict.lines:
            not_whole.append(verdict.path)

    errors = over_runs(
        verify_run, runs_below(paths, scheduler), show, doing="verifying", jobs=jobs, scheduler=scheduler
    )
    end_with(max(worst_code(errors), 3 if not_whole else 0))


def verify_run(path: Path) -> VerificationResult:
    from dataclasses import replace

    from analysis.runs.copied_runs import local_run, restore_run_path
    from daq.store import judge

    with local_run(path) as directory:
        verdict = judge(directory)
    problems = tuple(restore_run_path(problem, directory, path) for problem in verdict.problems)
    return replace(verdict, path=path, problems=problems)


@command(app, "rig relabel runs/lap-3 --direction cw")
def relabel(
    paths: Runs,
    test: Annotated[DrivenTest | None, typer.Option(help="Test that the robot drove; default: unchanged.")] = None,
    direction: Annotated[
        Direction | None, direction_option("Direction that the circle was driven in; default: unchanged")
    ] = None,
    operator: Annotated[str | None, typer.Option(help="Name of the operator; default: unchanged.")] = None,
    placement: Annotated[
        str | None, typer.Option(help="Label of the place of instrument or ball, '' for none; default: unchanged.")
    ] = None,
) -> None:
    """Correct the labels of runs; the ledgers keep the old labels."""
    from daq.store import relabel as relabel_run

    if test is None and direction is None and operator is None and placement is None:
        raise typer.BadParameter("give --test, --direction, --operator or --placement")

    def correct(path: Path) -> None:
        manifest = relabel_run(path, test=test, direction=direction, operator=operator, placement=placement)
        words = " ".join(filter(None, (manifest.test, manifest.direction)))
        place = f" at {manifest.placement}" if manifest.placement else ""
        say(f"{path}: {words}{place}, measured by {manifest.operator or 'an unnamed operator'}")

    for_each(paths, correct)
