"""The runs below a URL, by listing alone: no file is read.

An object store lists a thousand objects in one request, whatever directories their names form, so it is asked once for
all; elsewhere each directory is a request. A process of its own asks: the packages of stores start threads, which a
process that forks later must not have, and one that waits for a store is ended by Ctrl-C at once.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from analysis.batch.outcomes import Failed
from analysis.batch.processes import in_processes
from analysis.batch.remote_path import RemotePath
from analysis.batch.remote_store import (
    RemoteFile,
    StoreLost,
    entries,
    explained,
    is_plain,
    name_below,
    opened,
    remote_file,
)
from analysis.batch.run_files import NO_RUNS, is_run
from rigs.errors import RigError

OBJECT_STORES = ("s3", "s3a", "gs", "gcs", "abfs", "abfss", "az", "oss", "oci", "r2")
Steps = tuple[str, ...]
"""The names of a directory below another."""


@dataclass(frozen=True)
class RemoteRun:
    """A run elsewhere; files: in its directory, None where that may not be listed."""

    path: RemotePath
    files: tuple[RemoteFile, ...] | None


def remote_runs(top: RemotePath) -> list[RemoteRun]:
    """The runs below a URL, or the one that it names, in the order of names. Raises RigError."""
    (outcome,) = in_processes(listed, [top], 1)
    if isinstance(outcome, Failed):
        raise outcome.error
    return outcome.value


def listed(top: RemotePath) -> list[RemoteRun]:
    """The same in this process."""
    with explained(top):
        store, folder = opened(top)
        folders = _of_objects(store, folder) if top.protocol in OBJECT_STORES else _walked(store, folder, top)
        return [RemoteRun(top.joinpath(*steps), files) for steps, files in _runs(folders)]


def _runs(folders: Iterable[tuple[Steps, tuple[RemoteFile, ...] | None]]) -> Iterator[tuple[Steps, Any]]:
    """Those of the directories that are runs or may hold some; none within another run."""
    run: Steps | None = None
    for steps, files in folders:
        if run is not None and steps[: len(run)] == run:
            continue
        if files is None or is_run(file.name for file in files):
            run = steps
            yield steps, files


def _of_objects(store: Any, folder: str) -> Iterator[tuple[Steps, tuple[RemoteFile, ...]]]:
    """The directories below another, that itself first, by the names of all objects."""
    folders: dict[Steps, list[RemoteFile]] = {}
    store.invalidate_cache(folder)
    for name, info in store.find(folder, detail=True).items():
        *steps, file = name_below(folder, name).split("/")
        if info["type"] == "file" and all(map(is_plain, [*steps, file])) and not any(s.startswith(".") for s in steps):
            folders.setdefault(tuple(steps), []).append(remote_file(file, info))
    for key, files in sorted(folders.items()):
        yield key, tuple(sorted(files, key=lambda file: file.name))


def _walked(store: Any, top: str, where: RemotePath) -> Iterator[tuple[Steps, tuple[RemoteFile, ...] | None]]:
    """The same, directory by directory; one that may not be listed is given without files."""
    todo: list[Steps] = [()]
    while todo:
        steps = todo.pop()
        try:
            with explained(where.joinpath(*steps)):
                files, folders = entries(store, "/".join([top.rstrip("/"), *steps]) or "/")
        except StoreLost:
            raise
        except RigError:
            if not steps:
                raise
            if steps[-1] != NO_RUNS:
                yield steps, None
            continue
        yield steps, tuple(files)
        todo += [(*steps, name) for name in reversed(folders) if not name.startswith(".")]
