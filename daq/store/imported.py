"""A table from elsewhere as a run like any other: a manifest, and the table in one Parquet chunk.

The chunk carries the opening manifest as every chunk does, and the ledger is sealed when the
chunk is durable, so that an import cut off is seen, and brought back or given up by `recover`.
"""

from __future__ import annotations

import re
from pathlib import Path

import pyarrow as pa

from daq.store import durable
from daq.store.chunk import to_parquet, with_opening
from daq.store.ledger import Entry, Ledger
from daq.store.manifest import Manifest, hold_operator, load_manifest, new_manifest
from daq.store.records import ImportedTable, Seal, chunk_name, iso_now
from daq.store.schema import FAULTS, TABLE
from daq.store.stream_writer import describe
from rigs.errors import CellError, FileError
from rigs.schema.vocabulary import Direction, TestName


def write_table_run(  # noqa: PLR0913 - what a manifest needs to know
    path: Path,
    table: pa.Table,
    *,
    test: TestName,
    direction: Direction | None,
    rig_name: str,
    rig_text: str,
    operator: str,
    source: str,
    source_sha256: str,
    placement: str = "",
) -> Manifest:
    """Make the run directory `path` of a table of double, int64 and string columns without nulls.

    source, source_sha256: name and checksum of the file that the table was read from. The run's name is
    that of its directory. Raises FileError where path exists or the operator holds control characters, CellError when
    the disk refuses; then nothing is left of it.
    """
    columns = {field.name: str(field.type) for field in table.schema}
    manifest = new_manifest(
        name=_name(path),
        test=test,
        direction=direction,
        rig_name=rig_name,
        rig_text=rig_text,
        operator=hold_operator(str(path), operator),
        placement=placement,
        streams={},
        table=ImportedTable.model_validate({"file": source, "sha256": source_sha256, "columns": columns}),
    )
    try:
        durable.make_directories(path.parent)
        durable.make_directory(path)
    except FileExistsError:
        raise FileError(str(path), "is there already", "give the run a directory of its own") from None
    except OSError as error:
        raise _refused(path, error) from error
    try:
        return _fill(path, manifest, table)
    except (OSError, pa.ArrowException) as error:
        durable.discard(path)
        raise _refused(path, error) from error


def _fill(path: Path, manifest: Manifest, table: pa.Table) -> Manifest:
    held = durable.lock(path)
    try:
        manifest.save(path)
        ledger = Ledger.create(path, manifest.opening())
        durable.sync_directory(path.parent)
        whole = table.cast(manifest.arrow_schema(TABLE)).combine_chunks()
        data = to_parquet(whole.cast(with_opening(manifest.arrow_schema(TABLE), manifest.opening())))
        file = path / chunk_name(TABLE, 1)
        durable.replace(file, data)
        ledger.append(Entry(chunk=describe(file.name, TABLE, table, data)))
        rows = table.num_rows
        ledger.append(
            Entry(
                seal=Seal(
                    exit_status="complete",
                    reason="imported",
                    ended=iso_now(),
                    rows={TABLE: rows, FAULTS: 0},
                    counters={TABLE: {"samples": rows}},
                )
            )
        )
        ledger.close()
    finally:
        durable.close(held)
    return load_manifest(path)


def _name(path: Path) -> str:
    """What to call the run: the directory's name, with _ for what a run's name cannot hold."""
    return re.sub(r"[^A-Za-z0-9_.-]", "_", path.resolve().name).lstrip(".-")[:100] or TABLE


def _refused(path: Path, error: Exception) -> CellError:
    what = getattr(error, "strerror", None) or str(error).partition("\n")[0]
    return CellError(str(path), f"cannot be written: {what}", "make room or choose another directory")
