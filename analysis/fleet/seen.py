"""What lies below the directory of a plant, by names, sizes and times of files alone: no run is opened.

Of files elsewhere the store says what it knows of their state: an object store gives each a digest, its ETag.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from analysis.batch.remote_path import RemotePath
from analysis.batch.remote_runs import RemoteRun, remote_runs
from analysis.batch.run_directories import run_directories
from analysis.batch.run_files import has_figures
from rigs.errors import FileError


@dataclass(frozen=True)
class Seen:
    """A run as it lies there. run: its path below the plant's directory; signature: a digest of the names, sizes and
    times of its files, empty where they cannot be listed or do not show whether a file has changed."""

    path: Path
    run: str
    signature: str


def seen_runs(directory: Path) -> Iterator[Seen]:
    """Every run below a directory, in the order of their paths. Raises FileError where there is no such directory,
    CellError where a store does not answer."""
    if isinstance(directory, RemotePath):
        for run in remote_runs(directory):
            if run.path != directory:
                yield Seen(run.path, "/".join(run.path.parts[len(directory.parts) :]), _remote_signature(run))
        return
    if not directory.is_dir():
        raise FileError(str(directory), "no such directory", "give the directory that holds the plant's runs")
    for path in run_directories([directory]):
        if path != directory:  # which stands for itself where no run lies below it
            yield Seen(path, os.path.relpath(path, directory), signature_of(path))


def signature_of(run: Path) -> str:
    """A digest of the names, sizes and times of a run's files; it costs a call of the system a file, whatever their
    size. Empty where they cannot be listed."""
    try:
        with os.scandir(run) as entries:
            files = [(entry.name, entry.stat()) for entry in entries if has_figures(entry.name)]
    except OSError:
        return ""
    return _digest((name, status.st_size, str(status.st_mtime_ns)) for name, status in files)


def _remote_signature(run: RemoteRun) -> str:
    files = [file for file in run.files or () if has_figures(file.name)]
    if not files or not all(file.stamp for file in files):
        return ""
    return _digest((file.name, file.size, file.stamp) for file in files)


def _digest(files: Iterable[tuple[str, int, str]]) -> str:
    """A digest of names, sizes and times or other stamps."""
    digest = hashlib.sha256()
    for name, size, stamp in sorted(files):
        digest.update(f"{name} {size} {stamp}\n".encode("utf-8", "surrogateescape"))
    return digest.hexdigest()
