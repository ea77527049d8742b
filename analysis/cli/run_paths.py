"""Runs as a person types them: each once, and their doubts on standard error before anything is computed."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from analysis.cli.console import say

if TYPE_CHECKING:
    from analysis import Measured


def distinct(paths: Iterable[Path]) -> dict[Path, None]:
    """Each path once, in the order given."""
    return dict.fromkeys(path.resolve() for path in paths)


def load_runs(paths: Iterable[Path]) -> list[Measured]:
    """The runs, their doubts written to standard error. Raises FileError."""
    from analysis import load_run  # noqa: PLC0415

    runs = [load_run(path) for path in paths]
    for run in runs:
        for doubt in run.doubts:
            say(f"{run.title}, {run.run.manifest.name}: {doubt}", err=True)
    return runs
