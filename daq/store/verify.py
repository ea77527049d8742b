"""Is a run whole? Everything that its manifest promises, held against the files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from daq.store.durable import TEMPORARY
from daq.store.manifest import Manifest, load_manifest, sha256
from daq.store.marks import load_marks
from daq.store.run import read_chunk
from daq.store.schema import TABLE
from rigs.errors import FileError


def verify(path: Path) -> list[str]:
    """Return what is wrong with a run, one line each; empty if nothing is.

    Reads every byte: that each chunk is there, unchanged and as declared, that no row is missing in
    between, that no file is left over, and that the run was ended.
    """
    try:
        manifest = load_manifest(path)
    except FileError as error:
        return [str(error)]
    problems = [problem for stream in manifest.all_streams for problem in _stream(path, manifest, stream)]
    return _manifest(path, manifest) + _marks(path) + _left_over(path, manifest) + problems


def _marks(path: Path) -> list[str]:
    try:
        load_marks(path)
    except FileError as error:
        return [str(error)]
    return []


def _manifest(path: Path, manifest: Manifest) -> list[str]:
    problems = []
    if manifest.exit_status == "recording":
        problems.append(f"{path}: was never ended; it is being recorded or it crashed")
    if sha256(manifest.rig_text.encode()) != manifest.rig_sha256:
        problems.append(f"{path}: the rig file in the manifest does not match its SHA-256")
    if manifest.table and not manifest.chunks_of(TABLE):
        problems.append(f"{path}: its table is not there; import {manifest.table.file} again")
    return problems


def _left_over(path: Path, manifest: Manifest) -> list[str]:
    listed = {chunk.file for chunk in manifest.chunks}
    unlisted = {file for file in path.glob("*.parquet") if file.name not in listed}
    files = sorted(unlisted | {*path.glob("*.arrow"), *path.glob(f"*{TEMPORARY}")})
    return [f"{file}: is not in the manifest; run `rig recover {path}`" for file in files]


def _stream(path: Path, manifest: Manifest, stream: str) -> list[str]:
    schema = manifest.arrow_schema(stream)
    problems, row = [], 0
    for chunk in manifest.chunks_of(stream):
        try:
            rows = read_chunk(path, chunk, schema)
        except FileError as error:
            problems.append(str(error))
            row += chunk.rows
            continue
        if stream != TABLE:
            sequence = rows["sequence"].to_numpy()
            wrong = np.flatnonzero(np.diff(sequence, prepend=row - 1) != 1)
            problems += [f"{path / chunk.file}: rows are missing or doubled before row {i}" for i in wrong]
            row = int(sequence[-1]) + 1 if len(sequence) else row
    return problems
