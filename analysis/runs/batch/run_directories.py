"""Expand user input to runs: a directory or URL stands for all runs below it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path

from analysis.runs.batch.remote_path import RemotePath
from analysis.runs.batch.remote_store import NO_RUNS
from daq.store.manifest import is_run
from rigs.errors import FileError


def run_directories(paths: Iterable[Path]) -> list[Path]:
    """Runs given by paths, in the given order without repetition, and in order of names within a directory.

    A path that contains no runs is returned unchanged, and reading it then reports the problem. Raises CellError if a
    store does not respond.
    """
    runs: dict[Path, Path] = {}
    for path in paths:
        below: list[Path] = []
        if isinstance(path, RemotePath):
            from analysis.runs.batch.remote_store import remote_runs  # noqa: PLC0415 - not for a directory

            with suppress(FileError):
                below = [run.path for run in remote_runs(path)]
        elif not _is_run(path):
            below = list(_runs_below(path))
        for run in below or [path]:
            runs.setdefault(run.resolve(), run)
    return list(runs.values())


def _runs_below(top: Path) -> Iterator[Path]:
    """Runs below a directory. Each directory is entered once, even if several links lead to it.

    An unreadable directory is returned like a run, because it may contain runs.
    """
    entered: set[tuple[int, int]] = set()
    todo = [top]
    while todo:
        folder = todo.pop()
        if folder != top and _is_run(folder):
            yield folder
            continue
        try:
            status = folder.stat()
            identity = (status.st_dev, status.st_ino)
            below = (
                sorted(entry for entry in folder.iterdir() if not entry.name.startswith(".") and entry.is_dir())
                if identity not in entered
                else []
            )
        except NotADirectoryError:
            continue
        except OSError:
            if folder.name != NO_RUNS:
                yield folder
            continue
        entered.add(identity)
        todo += reversed(below)


def _is_run(path: Path) -> bool:
    """True if a directory is an accessible run."""
    try:
        return is_run(path)
    except OSError:
        return False
