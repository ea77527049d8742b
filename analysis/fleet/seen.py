"""What lies below the directory of a plant, by names, sizes and times of files alone: no run is opened."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from analysis.batch.run_directories import run_directories
from daq.store.ledger import LEDGER
from daq.store.manifest import MANIFEST
from rigs.errors import FileError

_OF_FIGURES = (MANIFEST, LEDGER)
_ENDINGS = (".parquet", ".arrow")
"""Files that figures follow from; marks, which say that a run was exported or is kept, change none."""


@dataclass(frozen=True)
class Seen:
    """A run as it lies there. run: its path below the plant's directory; signature: a digest of the names, sizes and
    times of its files, empty where they cannot be listed."""

    path: Path
    run: str
    signature: str


def seen_runs(directory: Path) -> Iterator[Seen]:
    """Every run below a directory, in the order of their paths. Raises FileError where there is no such directory."""
    if not directory.is_dir():
        raise FileError(str(directory), "no such directory", "give the directory that holds the plant's runs")
    for path in run_directories([directory]):
        if path != directory:  # which stands for itself where no run lies below it
            yield Seen(path, os.path.relpath(path, directory), signature_of(path))


def signature_of(run: Path) -> str:
    """A digest of the names, sizes and times of a run's files; it costs a call of the system a file, whatever their
    size. Empty where they cannot be listed."""
    found = hashlib.sha256()
    try:
        with os.scandir(run) as entries:
            files = sorted((one.name, one.stat()) for one in entries if _counts(one.name))
    except OSError:
        return ""
    for name, status in files:
        found.update(f"{name} {status.st_size} {status.st_mtime_ns}\n".encode("utf-8", "surrogateescape"))
    return found.hexdigest()


def _counts(name: str) -> bool:
    return name in _OF_FIGURES or name.endswith(_ENDINGS)
