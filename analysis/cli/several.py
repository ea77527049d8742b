"""Several runs or files in one command: a failure costs only its own part, and the exit code reports it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import typer

from analysis.cli.console import say_error
from rigs.errors import RigError


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
    if max(codes):
        raise typer.Exit(max(codes))
