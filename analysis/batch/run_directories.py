"""From what a person names to runs: a directory that is no run stands for every run below it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from daq.store.ledger import LEDGER
from daq.store.manifest import MANIFEST

_NO_RUNS = "lost+found"
"""What a file system puts at its top, for root alone."""


def run_directories(paths: Iterable[Path]) -> list[Path]:
    """The runs that the paths stand for, in the order given, each once; of a directory in the order of names.

    A path that holds no run stands for itself: whoever reads it finds out what is wrong with it.
    """
    found: dict[Path, Path] = {}
    for path in paths:
        for run in [path] if _is_run(path) else list(_runs_below(path, ())) or [path]:
            found.setdefault(run.resolve(), run)
    return list(found.values())


def _runs_below(folder: Path, above: tuple[tuple[int, int], ...]) -> Iterator[Path]:
    """The runs in a folder and in those below it; above: the folders that it lies in, where links lead no further.

    A directory that may not be read is given as if it were a run, since it may hold some.
    """
    try:
        status = folder.stat()
        here = (status.st_dev, status.st_ino)
        entries = sorted(folder.iterdir()) if here not in above else []
    except NotADirectoryError:
        return
    except OSError:
        if folder.name != _NO_RUNS:
            yield folder
        return
    for entry in entries:
        if entry.name.startswith(".") or not entry.is_dir():
            continue
        if _is_run(entry):
            yield entry
        else:
            yield from _runs_below(entry, (*above, here))


def _is_run(path: Path) -> bool:
    """Whether a directory is a run, however damaged: one without a manifest may have its ledger."""
    try:
        return (path / MANIFEST).exists() or (path / LEDGER).exists()
    except OSError:
        return False
