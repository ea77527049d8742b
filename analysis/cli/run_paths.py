"""Runs as a person types them: each once, and their doubts on standard error before anything is computed."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from analysis.cli.console import say

if TYPE_CHECKING:
    from analysis import Measured
    from rigs.errors import RigError


def distinct(paths: Iterable[Path]) -> dict[Path, None]:
    """Each path once, in the order given."""
    return dict.fromkeys(path.resolve() for path in paths)


def runs_below(paths: Iterable[Path], scheduler: str | None = None) -> list[Path]:
    """The runs that the paths stand for; absolute for a cluster, whose workers have directories of their own."""
    from analysis.batch.run_directories import run_directories
    from analysis.cli.progress import progress_of

    with progress_of("listing the runs", is_still=True):
        return [run if scheduler is None else run.absolute() for run in run_directories(paths)]


def load_runs(
    paths: Iterable[Path], *, jobs: int = 1, scheduler: str | None = None
) -> tuple[list[Measured], list[RigError]]:
    """The runs that can be read, their doubts written to standard error, and the errors of the others."""
    from analysis.cli.several import over_runs
    from analysis.traces.loading import load_measured

    runs: list[Measured] = []
    errors = over_runs(load_measured, list(paths), runs.append, doing="reading", jobs=jobs, scheduler=scheduler)
    say_doubts(runs)
    return runs, errors


def say_doubts(runs: Iterable[Measured]) -> None:
    """Print what a person should know of each run before it is used, on standard error."""
    from analysis.conventions.check import doubts_of

    for run in runs:
        for doubt in doubts_of(run):
            say(f"{run.title}, {run.run.manifest.name}: {doubt}", err=True)
