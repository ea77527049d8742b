"""The directory of a run that is recorded: its name, the writer's lock on it, its manifest, its ledger, and its end."""

from __future__ import annotations

import re
from collections.abc import Mapping
from contextlib import suppress
from itertools import count
from pathlib import Path

from daq import clock
from daq.store import durable
from daq.store.ledger import Ledger
from daq.store.manifest import MANIFEST, Manifest
from daq.store.room import TO_BEGIN_BYTES, require_room
from rigs.errors import CellError

_TIMED = re.compile(r"[0-9]{8}T[0-9]{6}[.0-9]*Z")
"""The UTC time that some names begin with; their directories are named after them alone."""
_WHO_DELETES = "find out what deletes or moves runs"


class RunRemoved(CellError):
    """The error for a run whose directory is gone while it is recorded."""

    def __init__(self, run: Path) -> None:
        super().__init__(str(run), "the directory was removed during the recording", _WHO_DELETES)


def require_files(run: Path, open_files: Mapping[Path, int]) -> None:
    """Raise RunRemoved for a run that is gone, CellError where its manifest or an open file is. Raises OSError.

    open_files: descriptor of each by its path.
    """
    if not run.is_dir():
        raise RunRemoved(run)
    vanished = [path for path, fd in open_files.items() if not durable.is_named(fd, path)]
    if not (run / MANIFEST).exists():
        vanished.append(run / MANIFEST)
    if vanished:
        raise CellError(str(vanished[0]), "has vanished during the recording", _WHO_DELETES)


def create_run_directory(runs: Path, manifest: Manifest, companions: Mapping[str, bytes]) -> tuple[Path, int, Ledger]:
    """Create a fresh directory `<UTC time>_<name>` under runs, with the files that belong beside the rig file.

    Return it with the run's lock and its ledger.

    Raises NearlyFull if there is too little room to begin, OSError if the disk refuses.
    """
    durable.make_directories(runs)
    require_room(runs, TO_BEGIN_BYTES + sum(map(len, companions.values())))
    path = _fresh_directory(runs, manifest.name)
    try:
        lock = durable.lock(path)
        try:
            write_beside(path, companions)
            manifest.save(path)
            durable.sync_directory(runs)
            return path, lock, Ledger.create(path, manifest.opening())
        except OSError:
            durable.close(lock)
            raise
    except OSError:
        durable.discard(path)
        raise


def write_beside(path: Path, companions: Mapping[str, bytes]) -> None:
    """Write the files that belong beside the rig file of a run into its directory, durably. The rig file has the digest
    of each, and the manifest that of the rig file. Raises OSError."""
    for name, content in companions.items():
        durable.replace(path / name, content)


def _fresh_directory(runs: Path, name: str) -> Path:
    stem = name if _TIMED.match(name) else f"{clock.wall_time():%Y%m%dT%H%M%SZ}_{name}"
    for number in count(1):
        path = runs / (stem if number == 1 else f"{stem}.{number}")
        with suppress(FileExistsError):
            durable.make_directory(path)
            return path
    raise AssertionError("count has no end")
