"""Several runs or files in one command, as a person types them: each once, with its doubts on standard error before
anything is computed; a failure costs only its own part, and the exit code reports it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import typer

from analysis.cli.console import say, say_error
from analysis.runs.batch.outcomes import Failed, Item, Value
from rigs.errors import FileError, RigError

if TYPE_CHECKING:
    from analysis import Measured, Result


def for_each(paths: Iterable[Path], work: Callable[[Path], None]) -> None:
    """Do the work for each path, once where a path is given twice.

    An error is reported as it happens, and the rest goes on. Raises typer.Exit with the highest exit code of all.
    """
    codes = [0]
    for path in dict.fromkeys(paths):
        try:
            work(path)
        except RigError as error:
            say_error(error)
            codes.append(error.exit_code)
        except typer.Exit as end:
            codes.append(end.exit_code)
    end_with(max(codes))


def end_with(code: int) -> None:
    """End the command with an exit code; 0 lets it go on. Raises typer.Exit."""
    if code:
        raise typer.Exit(code)


def worst(errors: Iterable[RigError]) -> int:
    """The highest exit code of errors, 0 of none."""
    return max((error.exit_code for error in errors), default=0)


def over_runs(
    work: Callable[[Item], Value],
    runs: Sequence[Item],
    use: Callable[[Value], None],
    *,
    doing: str,
    jobs: int = 1,
    scheduler: str | None = None,
) -> list[RigError]:
    """Do the work for each run, wherever, and use its value as soon as it and those before it are there.

    doing: in words, for a terminal. An error is reported as it comes, and the rest goes on. Returns the errors. Raises
    StoreLost where a store does not answer any more, since the rest would fail as well.
    """
    from analysis.cli.console import progress_of
    from analysis.runs.batch.each import each
    from analysis.runs.batch.remote_store import StoreLost

    errors: list[RigError] = []
    done = 0
    with closing(each(work, runs, jobs=jobs, scheduler=scheduler)) as outcomes:
        try:
            for number, run in enumerate(runs, 1):
                count = f" ({number} of {len(runs)})" if len(runs) > 1 else ""
                with progress_of(f"{doing} {run}{count}", is_still=jobs != 1 or scheduler is not None):
                    outcome = next(outcomes)
                if isinstance(outcome, Failed) and isinstance(outcome.error, StoreLost):
                    raise outcome.error
                if isinstance(outcome, Failed):
                    say_error(outcome.error)
                    errors.append(outcome.error)
                else:
                    if outcome.deaths:
                        say(f"note: {outcome.item}: the process was killed, and the run was restarted", err=True)
                    use(outcome.value)
                done += 1
        except KeyboardInterrupt:
            if done < len(runs) > 1:
                others = " and what follows" if done + 1 < len(runs) else ""
                say(f"interrupted after {done} of {len(runs)} runs: not done is {runs[done]}{others}", err=True)
            raise
    return errors


def evaluated(
    runs: Sequence[Path], *, jobs: int = 1, scheduler: str | None = None, with_rows: bool = True
) -> tuple[list[Result], list[RigError]]:
    """The results of the runs that can be evaluated, as `evaluate_runs` gives them, and the errors of the others.

    with_rows: keep the rows of each run; figures and doubts alone take some 0.2 MB a run."""
    from analysis.procedures.results import (
        borrowers,
        evaluated_again,
        figures_again,
        figures_alone,
        read_and_evaluated,
    )

    first: list[Result] = []
    work = read_and_evaluated if with_rows else figures_alone
    errors = over_runs(work, runs, first.append, doing="evaluating", jobs=jobs, scheduler=scheduler)
    results = dict(enumerate(first))
    to_repeat = borrowers(first)
    for borrower in to_repeat:
        del results[borrower.place]
    errors += over_runs(
        evaluated_again if with_rows else figures_again,
        to_repeat,
        lambda result: results.update([result]),
        doing="evaluating with the noise of other runs",
        jobs=jobs,
        scheduler=scheduler,
    )
    return [result for _, result in sorted(results.items())], errors


def distinct(paths: Iterable[Path]) -> dict[Path, None]:
    """Each path once, in the order given."""
    return dict.fromkeys(path.resolve() for path in paths)


def runs_below(paths: Iterable[Path], scheduler: str | None = None) -> list[Path]:
    """The runs that the paths stand for; absolute for a cluster, whose workers have directories of their own."""
    from analysis.cli.console import progress_of
    from analysis.runs.batch.run_directories import run_directories

    with progress_of("listing the runs", is_still=True):
        return [run if scheduler is None else run.absolute() for run in run_directories(paths)]


_TABLES = (".csv", ".tsv", ".txt", ".xlsx", ".dat")
"""How the names of tables end, which stand in the place of runs."""
_imported: list[TemporaryDirectory[str]] = []
"""Where tables were imported to for one command; each is removed as the command ends."""


def with_tables(paths: Iterable[Path], rig_file: str | None) -> list[Path]:
    """Return the paths, each table among them as a run that lasts as long as the command. Raises FileError."""
    return [_run_of(path, rig_file) if path.suffix.lower() in _TABLES and path.is_file() else path for path in paths]


def _run_of(table: Path, rig_file: str | None) -> Path:
    """Import a table, whose test its columns say, into a temporary directory; return that of its run."""
    from analysis.api import read_table, save_run

    if rig_file is None:
        problem = "is a table without an arm"
        raise FileError(str(table), problem, "give --rig CELL.yaml, or --arm NAME (listed by rig arms)")
    measured = read_table(table, rig_file)
    say(f"{table}: read as a {measured.run.manifest.test} table of {rig_file}, according to the columns", err=True)
    _imported.append(TemporaryDirectory(prefix="rig-"))
    return save_run(measured, Path(_imported[-1].name) / table.stem)


def load_runs(
    paths: Iterable[Path], *, jobs: int = 1, scheduler: str | None = None
) -> tuple[list[Measured], list[RigError]]:
    """The runs that can be read, their doubts written to standard error, and the errors of the others."""
    from analysis.runs.loading import load_measured

    runs: list[Measured] = []
    errors = over_runs(load_measured, list(paths), runs.append, doing="reading", jobs=jobs, scheduler=scheduler)
    say_doubts(runs)
    return runs, errors


def say_doubts(runs: Iterable[Measured]) -> None:
    """Print what a person should know of each run before it is used, on standard error."""
    from analysis.procedures.checks.check_runs import doubts_of

    for run in runs:
        for doubt in doubts_of(run):
            say(f"{run.title}, {run.run.manifest.name}: {doubt}", err=True)
