"""Storage of an imported table as a normal run: a manifest, and the table in a single Parquet chunk.

The ledger is sealed once the chunk is durable, so `recover` detects an interrupted import, and repairs or rejects it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import pyarrow as pa

from daq.store import durable
from daq.store.chunk import FAULTS, TABLE, to_parquet, with_opening
from daq.store.ledger import ImportedTable, Ledger, LedgerEntry, Relabelling, Seal, chunk_name, iso_now
from daq.store.manifest import Manifest, check_operator, load_manifest, new_manifest
from daq.store.run import Run
from daq.store.run_directory import new_directory, write_beside
from daq.store.stream_writer import describe
from rigs.errors import CellError, FileError
from rigs.schema.vocabulary import Direction, TestName


def table_run(  # noqa: PLR0913 - what a manifest needs to know
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
    table_map: str = "",
    assumed: tuple[str, ...] = (),
    only_commanded: bool = False,
) -> Run:
    """A run in memory for a table of double, int64 and string columns without nulls. Nothing is written.

    path: directory that names the run. source, source_sha256: name and checksum of the original file. table_map,
    assumed: import map, and unconfirmed assumptions. only_commanded: the joint angles are commands, not measured.
    """
    columns = {field.name: str(field.type) for field in table.schema}
    opening = new_manifest(
        name=_name(path),
        test=test,
        direction=direction,
        rig_name=rig_name,
        rig_text=rig_text,
        operator=check_operator(operator),
        placement=placement,
        streams={},
        table=ImportedTable.model_validate({
            "file": source, "sha256": source_sha256, "columns": columns, "map": table_map, "assumed": assumed,
            "only_commanded": only_commanded,
        }),
    )  # fmt: skip
    whole = table.cast(opening.arrow_schema(TABLE)).combine_chunks()
    manifest = opening.with_entries(_entries(whole, _parquet(opening, whole)))
    return Run(path, manifest, {}, [], whole)


def write_table_run(run: Run, path: Path, companions: Mapping[str, bytes] | None = None) -> Manifest:
    """Create the directory `path` for a table run, which takes its name.

    companions: content of the files next to the rig file, by name. No directory remains after an error or Ctrl-C.
    """
    try:
        with new_directory(path) as made:
            write_beside(made, companions or {})
            name = _name(path)
            manifest = run.manifest.model_copy(update={"version": 2, "name": name})
            lock = durable.lock(made)
            try:
                manifest.save(made)
                ledger = Ledger.create(made, manifest.opening())
                data = _parquet(manifest, run.table)
                durable.replace(made / chunk_name(TABLE, 1), data)
                for entry in _entries(run.table, data, run.manifest.relabelled):
                    ledger.append(entry)
                ledger.close()
            finally:
                durable.close(lock)
    except FileExistsError:
        raise FileError(
            str(path), "exists already", "choose a different --output, or remove it first", code="output.exists"
        ) from None
    except (OSError, pa.ArrowException) as error:
        problem = getattr(error, "strerror", None) or str(error).partition("\n")[0]
        remedy = durable.remedy(error, "make room or choose a different directory")
        raise CellError(str(path), f"cannot be written: {problem}", remedy, code="output.not_writable") from error
    return load_manifest(path)


def _parquet(opening: Manifest, table: pa.Table) -> bytes:
    return to_parquet(table.cast(with_opening(opening.arrow_schema(TABLE), opening.opening())))


def _entries(table: pa.Table, data: bytes, relabelled: tuple[Relabelling, ...] = ()) -> list[LedgerEntry]:
    """Ledger entries after the opening: chunk, seal, and label history."""
    rows = table.num_rows
    counts = {"rows": {TABLE: rows, FAULTS: 0}, "counters": {TABLE: {"samples": rows}}}
    seal = Seal(exit_status="complete", reason="imported", ended=iso_now(), **counts)
    history = [LedgerEntry(relabelled=relabelled)] if relabelled else []
    return [LedgerEntry(chunk=describe(chunk_name(TABLE, 1), TABLE, table, data)), LedgerEntry(seal=seal), *history]


def _name(path: Path) -> str:
    return re.sub(r"[^A-Za-z0-9_.-]", "_", path.resolve().name).lstrip(".-")[:100] or TABLE
