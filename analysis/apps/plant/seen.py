"""Listing of the runs of a plant by names, sizes and times of files, without opening them.

Remote stores provide a state of each file, such as the ETag of an object store. A new or changed run is examined: the
catalogue stores the record and the rig file.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from analysis.apps.plant.collect import REASONS
from analysis.apps.plant.records import RunRecord, fingerprint_of, record_of, record_without_figures
from analysis.runs.batch.fetched import fetched, restore_run_path
from analysis.runs.batch.remote_path import RemotePath
from analysis.runs.batch.remote_store import has_figures, remote_runs
from analysis.runs.batch.run_directories import run_directories
from daq.store.retention import RunInfo, look
from rigs.errors import FileError


@dataclass(frozen=True)
class RunOnDisk:
    """A run on the disk.

    run: path relative to the plant's directory. signature: digest of the names, sizes and times of the files, empty if
    they cannot be listed or compared.
    """

    path: Path
    run: str
    signature: str


def seen_runs(directory: Path) -> Iterator[RunOnDisk]:
    """Yield every run below a directory in order of path.

    Raises FileError if the directory does not exist, and CellError if a store does not respond.
    """
    if isinstance(directory, RemotePath):
        for run in remote_runs(directory):
            if run.path != directory:
                files = [file for file in run.files or () if has_figures(file.name)]
                stamped = files and all(file.stamp for file in files)
                signature = _digest((file.name, file.size, file.stamp) for file in files) if stamped else ""
                yield RunOnDisk(run.path, "/".join(run.path.parts[len(directory.parts) :]), signature)
        return
    if not directory.is_dir():
        raise FileError(str(directory), "no such directory", "give the directory with the plant's runs")
    for path in run_directories([directory]):
        if path != directory:  # It is returned itself if there are no runs.
            yield RunOnDisk(path, os.path.relpath(path, directory), signature_of(path))


def signature_of(run: Path) -> str:
    """Return a digest of names, sizes and times of a run's files, with one system call per file; empty if
    unreadable.
    """
    try:
        with os.scandir(run) as entries:
            files = [(entry.name, entry.stat()) for entry in entries if has_figures(entry.name)]
    except OSError:
        return ""
    return _digest((name, status.st_size, str(status.st_mtime_ns)) for name, status in files)


def _digest(files: Iterable[tuple[str, int, str]]) -> str:
    """Return a digest of names, sizes and times or other stamps."""
    digest = hashlib.sha256()
    for name, size, stamp in sorted(files):
        digest.update(f"{name} {size} {stamp}\n".encode("utf-8", "surrogateescape"))
    return digest.hexdigest()


@dataclass(frozen=True)
class Examined:
    """The record of a run.

    rig_text: rig file of the run. is_evaluated: whether it was evaluated; then only a change requires a new
    examination.
    """

    record: RunRecord
    rig_text: str = ""
    is_evaluated: bool = True


def examine(path: Path) -> Examined | None:
    """Evaluate a run, and return the record with figures or the reason for failure; None if the run is gone.

    Never raises for a bad run. Raises RigError for a remote run that cannot be fetched.
    """
    with fetched(path) as directory:
        examined = _examined(directory)
    if examined is None:
        return None
    record = replace(
        examined.record, name=path.name, problem=restore_run_path(examined.record.problem, directory, path)
    )
    return replace(examined, record=record)


def _examined(path: Path) -> Examined | None:
    try:
        run = look(path)
    except OSError as error:
        if isinstance(error, FileNotFoundError) and not os.path.lexists(path):
            return None
        unreadable = RunInfo(path, None, None, "damaged", 0, 0.0)
        return Examined(record_without_figures(unreadable, error.strerror or str(error)), is_evaluated=False)
    if run.manifest is None or run.status in REASONS:
        return Examined(record_without_figures(run, REASONS[run.status]), _rig_text(run), is_evaluated=False)
    try:
        fingerprint = fingerprint_of(run.path)
    except (OSError, FileError) as error:
        return Examined(record_without_figures(run, str(error)), _rig_text(run), is_evaluated=False)
    return Examined(record_of(run.path, run.manifest, fingerprint), _rig_text(run))


def _rig_text(run: RunInfo) -> str:
    return run.manifest.rig_text if run.manifest else ""
