"""Reading of runs: all chunks of each stream as arrays, or an error.

A wrong number is worse than a missing one, so the SHA-256 and row count of each chunk are verified before use.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from daq.store.chunk import FAULTS, MOST_BYTES, TABLE, array_of, from_parquet, piece_of
from daq.store.durable import TEMPORARY, is_locked
from daq.store.ledger import BEING_RECORDED, LEDGER, Chunk, VerifiedLedger, read_ledger, sha256, to_recover
from daq.store.manifest import Manifest, load_manifest, unreadable
from rigs.errors import FileError
from rigs.files import read_bytes


@dataclass(frozen=True)
class Run:
    path: Path
    manifest: Manifest
    streams: dict[str, dict[str, np.ndarray[Any, Any]]]
    """Columns (n,) of each sample stream in file units: the fixed ones of `daq.store.chunk`, then the values."""
    faults: list[dict[str, Any]]
    """A row for each fault: at_ns, stream, kind, detail, count, sequence."""
    table: pa.Table | None = None
    """Columns of an imported run in file order, None in a recorded run."""
    unsealed: tuple[str, ...] = ()
    """Content of the directory that belongs to no run, one line each."""

    @cached_property
    def readings_sha256(self) -> str:
        """Digest of the measurements. Copies of a run and repeated imports of a table have equal digests."""
        if self.table is None:
            return sha256("".join(chunk.sha256 for chunk in self.manifest.chunks).encode())
        plain, rows = self.table.replace_schema_metadata(None).combine_chunks(), pa.BufferOutputStream()
        with pa.ipc.new_stream(rows, plain.schema) as stream:
            stream.write_table(plain)
        return sha256(rows.getvalue().to_pybytes())


def read_run(path: Path) -> Run:
    """Read a run. Raises FileError if it is missing, damaged, still being recorded, or crashed and not recovered."""
    manifest = closed_manifest(path)
    streams = {}
    for name in manifest.streams:
        rows = read_stream(path, manifest, name)
        streams[name] = {column: _array(rows[column]) for column in rows.column_names}
    table = read_stream(path, manifest, TABLE) if manifest.table else None
    faults = read_stream(path, manifest, FAULTS).to_pylist()
    return Run(path, manifest, streams, faults, table, tuple(unsealed_parts(path, manifest, read_ledger(path))))


def closed_manifest(path: Path) -> Manifest:
    manifest = load_manifest(path)
    recording = manifest.exit_status == "recording"
    try:
        locked = recording and is_locked(path)
    except OSError as error:
        raise unreadable(path, error) from None
    if locked:
        raise FileError(str(path), *BEING_RECORDED, code="run.in_use")
    if recording or any(path.glob("*.arrow")):
        raise FileError(str(path), "was not closed: the recording crashed", to_recover(path), code="run.in_use")
    return manifest


def is_unclosed(path: Path) -> bool:
    manifest = load_manifest(path)
    try:
        is_left = manifest.exit_status == "recording" or any((*path.glob("*.arrow"), *path.glob(f"*{TEMPORARY}")))
        return is_left and not is_locked(path)
    except OSError as error:
        raise unreadable(path, error) from None


def left_over(path: Path, manifest: Manifest) -> list[Path]:
    listed = {chunk.file for chunk in manifest.chunks}
    unlisted = {file for file in path.glob("*.parquet") if file.name not in listed}
    return sorted(unlisted | {*path.glob("*.arrow"), *path.glob(f"*{TEMPORARY}")})


def unsealed_parts(path: Path, manifest: Manifest, ledger: VerifiedLedger) -> list[str]:
    """Lines of the ledger after the last valid one, and files that it does not list. They are not read."""
    parts, place = [], "manifest" if manifest.version == 1 else "ledger"
    if manifest.version > 1 and ledger.entries and ledger.unread and manifest.exit_status != "recording":
        line = len(ledger.entries) + 1
        parts.append(f"{path / LEDGER}: line {line} and later lines cannot be verified; {to_recover(path)}")
    listed = left_over(path, manifest)
    return [*parts, *(f"{file}: is not listed in the {place}; {to_recover(path)}" for file in listed)]


def read_stream(path: Path, manifest: Manifest, stream: str) -> pa.Table:
    schema = manifest.arrow_schema(stream)
    tables = [read_chunk(path, chunk, schema) for chunk in manifest.chunks_of(stream)]
    # `schema.empty_table()` would import pandas if installed; see `daq.store.chunk`.
    return pa.concat_tables([pa.Table.from_batches([], schema), *tables])


def read_chunk(path: Path, chunk: Chunk, schema: pa.Schema, columns: Sequence[str] | None = None) -> pa.Table:
    file = path / chunk.file
    remedy = "restore the file from a copy of the run"
    try:
        data = read_bytes(file, MOST_BYTES)
    except FileNotFoundError:
        raise FileError(
            str(file), "is missing, although the ledger lists this chunk", remedy, code="run.damaged"
        ) from None
    except OSError as error:
        raise unreadable(file, error) from None
    if sha256(data) != chunk.sha256:
        raise FileError(str(file), "has changed since the recording (SHA-256)", remedy, code="run.damaged")
    try:
        table = from_parquet(data, columns)
    except OSError as error:
        raise unreadable(file, error) from None
    if table is None:
        raise FileError(str(file), "is not a Parquet file", remedy, code="run.damaged")
    if not table.schema.equals(schema if columns is None else pa.schema([schema.field(name) for name in columns])):
        problem = f"has the columns {', '.join(table.schema.names)}, which differ from the manifest"
        raise FileError(str(file), problem, remedy, code="run.damaged")
    if table.num_rows != chunk.rows:
        raise FileError(
            str(file), f"has {table.num_rows} rows, but the manifest states {chunk.rows}", remedy, code="run.damaged"
        )
    return table.replace_schema_metadata(None)


def _array(column: pa.ChunkedArray) -> np.ndarray[Any, Any]:
    """A column as an array. Equal values, as the request times of a streaming gauge, are a view of a single one."""
    pieces = [piece_of(chunk).view(f"i{column.type.bit_width // 8}") for chunk in column.chunks]
    first = next((piece[:1] for piece in pieces if len(piece)), None)
    if first is not None and all((piece == first).all() for piece in pieces):
        return np.broadcast_to(first.view(column.type.to_pandas_dtype()).copy(), (len(column),))
    return array_of(column)
