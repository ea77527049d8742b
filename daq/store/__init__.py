"""The store: runs that survive. `RunWriter` records, `read_run` reads, `recover` and `verify` look after.

A run is a directory: `manifest.json`, and for each stream chunks `<stream>-0001.parquet`, …; the chunk
being recorded is `<stream>-0001.arrow`. See `daq.store.chunk` for why these two formats.
"""

from daq.store.manifest import Chunk, Manifest, load_manifest
from daq.store.recover import Recovery, recover
from daq.store.run import Run, read_run
from daq.store.verify import verify
from daq.store.writer import RunWriter

__all__ = [
    "Chunk",
    "Manifest",
    "Recovery",
    "Run",
    "RunWriter",
    "load_manifest",
    "read_run",
    "recover",
    "verify",
]
