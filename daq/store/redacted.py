"""Copy of a run for publication: the same readings, with names of people and computers replaced in all texts."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow as pa

from daq.store.chunk import FAULTS, to_parquet, with_opening
from daq.store.ledger import LEDGER, LedgerEntry, Seal, chunk_name, lines_of, sha256
from daq.store.manifest import MANIFEST, Manifest
from daq.store.run import closed_manifest, read_stream
from daq.store.stream_writer import describe

_OF_RIG = "rig "
"""Begin of the operator in a run that rig itself made, such as `rig simulate`."""
_DETAIL = "detail"
"""Column of the faults with texts of the operating system, such as the path of a port."""


def redacted_files(path: Path, hide: Callable[[str], str]) -> tuple[str, dict[str, bytes]]:
    """Name of a run and the files of a copy, whose ledger proves it whole. The history of its labels is left out.

    hide: replacement of names in a text. Raises FileError for a run that is damaged or being recorded.
    """
    original = closed_manifest(path)
    plain = _hidden({**original.model_dump(mode="json"), "relabelled": (), "chunks": (), "version": 2}, hide)
    by_rig = not original.operator or original.operator.startswith(_OF_RIG)
    people = {"host": "host", "operator": original.operator if by_rig else "operator"}
    manifest = Manifest.model_validate(plain | people | {"rig_sha256": sha256(plain["rig_text"].encode())})
    opening, files, entries = manifest.opening(), {}, []
    for stream in original.all_streams:
        table = read_stream(path, original, stream).combine_chunks()
        if not table.num_rows:
            continue
        if stream == FAULTS:
            column = table.schema.get_field_index(_DETAIL)
            texts = [text and hide(text) for text in table[_DETAIL].to_pylist()]
            table = table.set_column(column, table.schema.field(column), pa.array(texts, table.schema.types[column]))
        name, schema = chunk_name(stream, 1), with_opening(manifest.arrow_schema(stream), opening)
        files[name] = to_parquet(table.cast(schema))
        entries.append(LedgerEntry(chunk=describe(name, stream, table, files[name])))
    seal = Seal(**{key: getattr(manifest, key) for key in Seal.model_fields})
    anchors = [LedgerEntry(anchor=anchor) for anchor in original.anchors]
    ledger = lines_of([LedgerEntry(opening=sha256(opening)), *entries, *anchors, LedgerEntry(seal=seal)])
    return manifest.name, {MANIFEST: opening, LEDGER: ledger, **files}


def _hidden(value: Any, hide: Callable[[str], str]) -> Any:
    match value:
        case str():
            return hide(value)
        case dict():
            return {key: _hidden(item, hide) for key, item in value.items()}
        case list() | tuple():
            return [_hidden(item, hide) for item in value]
    return value
