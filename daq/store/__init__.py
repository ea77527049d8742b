"""Crash-proof storage of runs.

A run is a directory with `manifest.json`, `ledger.jsonl`, and chunks `<stream>-0001.parquet`, … for each stream. The
chunk being recorded is `<stream>-0001.arrow`. An imported run has a single chunk, `table-0001.parquet`. `marks.json`
records exports and protection from deletion.
"""

from daq.store.imported import table_run, write_table_run
from daq.store.ledger import Chunk, Relabelling
from daq.store.manifest import Manifest, load_manifest, new_manifest
from daq.store.marks import MovementCheck, mark_exported, mark_kept, mark_moved, relabel
from daq.store.recover import Recovery, recover
from daq.store.retention import RunInfo, survey
from daq.store.run import Run, closed_manifest, is_unclosed, read_run
from daq.store.run_directory import NearlyFull
from daq.store.verify import VerificationResult, judge, verify
from daq.store.writer import RunWriter

__all__ = [
    "Chunk",
    "Manifest",
    "MovementCheck",
    "NearlyFull",
    "Recovery",
    "Relabelling",
    "Run",
    "RunInfo",
    "RunWriter",
    "VerificationResult",
    "closed_manifest",
    "is_unclosed",
    "judge",
    "load_manifest",
    "mark_exported",
    "mark_kept",
    "mark_moved",
    "new_manifest",
    "read_run",
    "recover",
    "relabel",
    "survey",
    "table_run",
    "verify",
    "write_table_run",
]
