"""The store: runs that survive. `RunWriter` records, `write_table_run` takes in a table from elsewhere,
`read_run` reads, `recover` and `verify` look after.

A run is a directory: `manifest.json`, `ledger.jsonl`, and for each stream chunks `<stream>-0001.parquet`, …; the chunk
being recorded is `<stream>-0001.arrow`. See `daq.store.chunk` for why these two formats. An imported run
has one chunk, `table-0001.parquet`. `marks.json` says whether the run was exported and whether it is kept.
"""

from daq.store.imported import table_run, write_table_run
from daq.store.ledger import Chunk, Relabelling
from daq.store.manifest import Manifest, load_manifest
from daq.store.marks import mark_exported, mark_kept, relabel
from daq.store.recover import Recovery, recover
from daq.store.retention import RunInfo, survey
from daq.store.run import Run, chunks_of, closed_manifest, is_unclosed, read_run
from daq.store.run_directory import NearlyFull
from daq.store.verify import Verdict, judge, verify
from daq.store.writer import RunWriter

__all__ = [
    "Chunk",
    "Manifest",
    "NearlyFull",
    "Recovery",
    "Relabelling",
    "Run",
    "RunInfo",
    "RunWriter",
    "Verdict",
    "chunks_of",
    "closed_manifest",
    "is_unclosed",
    "judge",
    "load_manifest",
    "mark_exported",
    "mark_kept",
    "read_run",
    "recover",
    "relabel",
    "survey",
    "table_run",
    "verify",
    "write_table_run",
]
