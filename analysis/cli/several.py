"""Commands on several runs or files: a failure affects only that item and the exit code."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import closing
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, overload

import typer

from analysis.cli.console import say, say_error
from rigs.errors import FileError, RigError, UseError

if TYPE_CHECKING:
    from analysis import Measured, Result
    from analysis.runs.batch import Item, Value
    from rigs.rig import Rig

_MOST_LISTED = 20
"""Maximum number of errors of one file on the screen."""


def for_each(paths: Iterable[Path], work: Callable[[Path], None]) -> None:
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
    if code:
        raise typer.Exit(code)


def worst_code(errors: Iterable[RigError]) -> int:
    return max((error.exit_code for error in errors), default=0)


def end_with_errors(errors: Sequence[RigError], rest: str) -> None:
    """Print the first errors and the number of the `rest`, and end the command with the highest exit code."""
    for error in errors[:_MOST_LISTED]:
        say_error(error)
    if len(errors) > _MOST_LISTED:
        say(f"      and {len(errors) - _MOST_LISTED} more{rest}", err=True)
    end_with(worst_code(errors))


def over_runs(
    work: Callable[[Item], Value],
    runs: Sequence[Item],
    use: Callable[[Value], None],
    *,
    doing: str,
    jobs: int = 1,
    scheduler: str | None = None,
) -> list[RigError]:
    """Do the work for each run, possibly elsewhere, and use the values in the order of the runs as soon as possible.

    doing: description for the terminal. Errors are reported immediately and returned.
    """
    from analysis.cli.console import progress_of
    from analysis.runs.batch import FailedItem, each

    errors: list[RigError] = []
    done = 0
    with closing(each(work, runs, jobs=jobs, scheduler=scheduler)) as outcomes:
        try:
            for number, run in enumerate(runs, 1):
                count = f" ({number} of {len(runs)})" if len(runs) > 1 else ""
                with progress_of(f"{doing} {run}{count}", is_still=jobs != 1 or scheduler is not None):
                    outcome = next(outcomes)
                if isinstance(outcome, FailedItem):
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


def evaluate_paths(
    runs: Sequence[Path], *, jobs: int = 1, scheduler: str | None = None, with_rows: bool = True
) -> tuple[list[Result], list[RigError]]:
    """Results of evaluable runs, as from `evaluate_runs`, and the errors of the others.

    with_rows: keep the rows of each run. Figures and remarks by themselves take some 0.2 MB per run.
    """
    from analysis.procedures.results import borrowed_noise, evaluate_path

    first: list[Result] = []
    again: list[Result] = []
    work = partial(evaluate_path, with_rows=with_rows)
    errors = over_runs(work, runs, first.append, doing="evaluating", jobs=jobs, scheduler=scheduler)
    like = {first[place].measured.path: noise for place, noise in borrowed_noise(first).items()}
    doing, work = "evaluating with the noise of other runs", partial(work, like=like)
    errors += over_runs(work, list(like), again.append, doing=doing, jobs=jobs, scheduler=scheduler)
    results = {one.measured.path: one for one in first if one.measured.path not in like}
    results |= {one.measured.path: one for one in again}
    return [results[run] for run in runs if run in results], errors


def runs_below(paths: Iterable[Path], scheduler: str | None = None) -> list[Path]:
    """Runs at or below paths; absolute for a cluster, since the workers run in other directories."""
    from analysis.cli.console import progress_of
    from analysis.runs.batch import run_directories

    with progress_of("listing the runs", is_still=True):
        return [run if scheduler is None else run.absolute() for run in run_directories(paths)]


_TABLES = (".csv", ".tsv", ".txt", ".xlsx", ".dat")
"""Suffixes of tables accepted in place of runs."""
_imported: list[TemporaryDirectory[str]] = []
"""Temporary directories of imported tables and changed rig files; each is removed when the command ends."""


def is_table(path: Path) -> bool:
    return path.suffix.lower() in _TABLES and path.is_file()


def with_tables(paths: Iterable[Path], rig_file: str | None) -> list[Path]:
    """Paths, with each table imported to a temporary run, which exists until the command ends."""
    from analysis.runs.batch import distinct
    from rigs.arms import arm_names

    paths = list(paths)
    for path in (path for path in paths if not path.exists()):
        if str(path) in arm_names():
            problem = "is an arm of the library, not a run"
            raise UseError(str(path), problem, f"give runs or tables, and the arm as --rig {path}", code="usage")
        if path.suffix.lower() in _TABLES:
            remedy = f"check the path; accepted are run directories, and tables ({', '.join(_TABLES)}) with --rig"
            raise FileError(str(path), "no such file or directory", remedy, code="file.missing")
    for path in paths:
        if path.is_file() and not is_table(path):
            _refuse_file(path)
    distinct(path for path in paths if is_table(path))
    return [_run_of(path, rig_file) if is_table(path) else path for path in paths]


def _refuse_file(path: Path) -> None:
    """Refuse a file that is neither a table nor a run. The error names the kind of the file, if it is known."""
    from analysis.intake.converted import is_convertible
    from analysis.intake.read import refuse_other_formats
    from analysis.intake.table_files import read_head
    from daq.store.manifest import MANIFEST
    from rigs.text import as_argument

    head, suffix = read_head(path), path.suffix.lower()
    if path.name == MANIFEST or (path.parent / MANIFEST).exists():
        remedy = f"give the directory: {as_argument(path.parent)}"
        raise FileError(str(path), "is a file of a run", remedy, code="run.missing")
    if suffix in (".yaml", ".yml"):
        remedy = f"give runs or tables, and a rig file as --rig {as_argument(path)}"
        raise UseError(str(path), "is a YAML file, such as a rig file, not a run", remedy, code="usage")
    if not is_convertible(head):
        refuse_other_formats(str(path), head)
    remedy = f"give a run directory, or a table ({', '.join(_TABLES)}) with --rig; others with rig import"
    raise FileError(str(path), f"is a file of the unknown type {suffix or '(none)'}", remedy, code="run.missing")


@overload
def with_controller(rig_file: str, calibration: str | None) -> str: ...
@overload
def with_controller(rig_file: str | None, calibration: str | None) -> str | None: ...
def with_controller(rig_file: str | None, calibration: str | None) -> str | None:
    """Rig file with the constants of the controller, which exists until the command ends, if any are given."""
    if calibration is None:
        return rig_file
    if rig_file is None:
        remedy = "give --arm NAME or --rig CELL.yaml too"
        raise UseError("--calibration", "needs the arm that it belongs to", remedy, code="usage")
    from analysis.intake.controller_arm import rig_with_controller
    from analysis.runs.written_files import holding, write_new
    from rigs.load import find, load

    rig, text = load(rig_file)
    rig, text, read = rig_with_controller(rig, text, calibration)
    say(read.words, err=True)
    for note in read.notes:
        say(note, err=True, mark="note: ")
    _imported.append(TemporaryDirectory(prefix="rig-"))
    folder = Path(_imported[-1].name)
    for name, content in rig.companion_files.items():
        write_new(folder / name, holding(content))
    file = folder / find(rig_file).name
    write_new(file, holding(text.encode()))
    return str(file)


def with_recorded_controller(rig: Rig, text: str, runs: Sequence[Measured]) -> tuple[Rig, str]:
    """Take the constants of the controller that the runs show into a rig and its text, and say so."""
    from analysis.intake.controller_arm import text_with_robot
    from analysis.runs.loading import as_recorded

    recorded = as_recorded(rig, runs)
    if recorded is rig:
        return rig, text
    own = "constants of its own" if recorded.controller == "constants" else "the constants of the data sheet"
    say(f"the controller computes with {own}, as the poses in the runs show", err=True)
    return recorded, text_with_robot(text, recorded.robot)


def _run_of(table: Path, rig_file: str | None) -> Path:
    from analysis.api import read_table, save_run
    from analysis.runs.copied_runs import CopiedRun

    if rig_file is None:
        problem = "is a table without an arm"
        remedy = "give --rig CELL.yaml, or --arm NAME (listed by rig arms)"
        raise FileError(str(table), problem, remedy, code="table.unclear")
    measured = read_table(table, rig_file)
    kind = f"a {measured.run.manifest.test} table of {Path(rig_file).name}"
    say(f"{table}: read as {kind}, according to the columns", err=True)
    _imported.append(TemporaryDirectory(prefix="rig-"))
    return CopiedRun.of(str(table), save_run(measured, Path(_imported[-1].name) / table.stem))


def load_runs(
    paths: Iterable[Path], *, jobs: int = 1, scheduler: str | None = None
) -> tuple[list[Measured], list[RigError]]:
    """Load the readable runs, print remarks on them, and give them with the errors of the others.

    The caller reports the runs that it refuses or ignores, so that no remark appears twice.
    """
    from analysis.runs.loading import load_measured

    runs: list[Measured] = []
    errors = over_runs(load_measured, list(paths), runs.append, doing="reading", jobs=jobs, scheduler=scheduler)
    say_doubts(runs, with_refusals=False)
    return runs, errors


def say_doubts(runs: Iterable[Measured], *, with_refusals: bool = True) -> None:
    """Print remarks on each run to standard error before it is used; with_refusals: see `doubts_of`."""
    from analysis.procedures.checks.check_runs import doubts_of

    for run in runs:
        for doubt in doubts_of(run, with_refusals=with_refusals):
            say(f"{run.title}, {run.run.manifest.name}: {doubt}", err=True)
