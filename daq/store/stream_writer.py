"""Writer of a single stream: rows are written to the disk in frames, and converted to a Parquet chunk at the end.

The recording chunk is append-only, and deleted only when the Parquet file is durable and in the ledger. The next chunk
starts only when the disk has stored all of the full one, so that a crash leaves no gap between them; rows are pending
meanwhile. A second thread creates the Parquet file. Functions raise plain OSError.
"""

from __future__ import annotations

import errno
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

import pyarrow as pa

from daq import clock
from daq.protocol.conversation import SampleBlock
from daq.store import durable
from daq.store.chunk import END, FAULTS, TABLE, Row, Salvage, batch_of, frame, head, salvage, table_of, to_parquet
from daq.store.ledger import Chunk, chunk_name, sha256


@dataclass
class OpenChunk:
    """A recording chunk. size: bytes in complete frames. synced: bytes on the disk. ended: after the end mark."""

    path: Path
    number: int
    fd: int
    size: int
    born_ns: int
    frames: int = 0
    rows: int = 0
    synced: int = 0
    named: bool = False
    ended: bool = False

    @property
    def is_synced(self) -> bool:
        return self.named and self.synced == self.size

    def append(self, data: bytes) -> None:
        """Append complete frames. If this fails, the file is unchanged."""
        try:
            durable.write_at(self.fd, data, self.size)
        except OSError:
            with suppress(OSError):
                durable.truncate(self.fd, self.size)
            raise
        self.size += len(data)

    def end(self) -> None:
        """Append the end mark once. The following steps may fail and be repeated."""
        if not self.ended:
            self.append(END)
            self.ended = True


class Pending:
    def __init__(self) -> None:
        self._parts: list[Sequence[Row]] = []
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[Row]:
        return iter(self.rows())

    def extend(self, rows: Iterable[Row]) -> None:
        part = rows if isinstance(rows, SampleBlock) else list(rows)
        self._parts.append(part)
        self._count += len(part)

    def rows(self) -> Sequence[Row]:
        if all(isinstance(part, SampleBlock) for part in self._parts):
            return SampleBlock.joined(cast("list[SampleBlock]", self._parts))
        return [row for part in self._parts for row in part]


@dataclass(frozen=True)
class Sync:
    """Sync of a chunk. Call `wait` once, in any thread."""

    chunk: OpenChunk
    fd: int
    size: int

    def wait(self) -> None:
        """Wait until all frames are on the disk, and update the chunk."""
        try:
            durable.sync(self.fd)
        finally:
            durable.close(self.fd)
        if not self.chunk.named:
            durable.sync_directory(self.chunk.path.parent)
        self.chunk.synced, self.chunk.named = self.size, True


@dataclass
class StreamWriter:
    """Writes a stream of a run.

    open: chunk being written, or ended and awaiting a sync. full: chunk that is ended, synced and being closed.
    """

    run: Path
    stream: str
    schema: pa.Schema
    pending: Pending = field(default_factory=Pending)
    rows: int = 0
    chunks: int = 0
    open: OpenChunk | None = None
    full: OpenChunk | None = None

    def append(self, rows: Iterable[Row]) -> None:
        self.pending.extend(rows)

    def unclosed(self) -> list[OpenChunk]:
        return [chunk for chunk in (self.full, self.open) if chunk]

    def count_lost_rows(self) -> int:
        """Lost rows at the end of a run: pending rows, and rows in a file without a name."""
        lost = len(self.pending)
        for chunk in self.unclosed():
            with suppress(OSError):  # the disk does not respond
                lost += 0 if durable.is_named(chunk.fd, chunk.path) else chunk.rows
        return lost

    def bytes_to_close(self) -> int:
        """Bytes needed at most to write the pending rows and a Parquet file per chunk.

        A Parquet file is not larger than the Arrow frames, which contain the same columns and a head per batch.
        """
        pending = 8 * len(self.schema) * len(self.pending)
        return 2 * pending + sum(chunk.size for chunk in self.unclosed())

    def write(self) -> None:
        """Append the pending rows as a batch, in a new chunk if none is open.

        While a chunk is waiting for a sync, the rows remain pending.
        """
        if self.open and self.open.ended:
            if self.full or not self.open.is_synced:
                return
            self.full, self.open = self.open, None
        if not len(self.pending):
            return
        if self.open is None:
            number = self.chunks + 1
            path = (self.run / chunk_name(self.stream, number)).with_suffix(".arrow")
            start = head(self.schema)
            self.open = OpenChunk(path, number, durable.create(path, start), len(start), clock.now_ns())
            self.chunks = number
        chunk = self.open
        batch = batch_of(self.pending.rows(), self.schema.remove_metadata(), self.rows)
        chunk.append(frame(batch, chunk.frames))
        self.pending = Pending()
        chunk.frames += 1
        chunk.rows += batch.num_rows
        self.rows += batch.num_rows

    def begin_sync(self) -> Sync | None:
        chunk = self.open
        return None if chunk is None or chunk.is_synced else Sync(chunk, durable.again(chunk.fd), chunk.size)

    def finish(self, chunk: OpenChunk) -> Chunk:
        chunk.end()
        if not chunk.is_synced:
            Sync(chunk, durable.again(chunk.fd), chunk.size).wait()
        salvaged = salvage(durable.read_all(chunk.fd), self.schema)  # works even if the file name is gone
        if salvaged.damage or salvaged.rows != chunk.rows:
            raise OSError(errno.EIO, f"{chunk.path.name} cannot be read back: {salvaged.damage or 'short'}")
        return store_chunk(self.run, self.stream, chunk.number, salvaged, self.schema)

    def delete_chunk(self, chunk: OpenChunk) -> None:
        self._release(chunk)
        with suppress(FileNotFoundError):
            durable.remove(chunk.path)

    def release(self) -> None:
        for chunk in self.unclosed():
            self._release(chunk)

    def _release(self, chunk: OpenChunk) -> None:
        durable.close(chunk.fd)
        if chunk is self.full:
            self.full = None
        else:
            self.open = None


def store_chunk(run: Path, stream: str, number: int, salvaged: Salvage, schema: pa.Schema) -> Chunk:
    table = table_of(salvaged.batches, schema)
    data = to_parquet(table)
    path = run / chunk_name(stream, number)
    durable.replace(path, data)
    return describe(path.name, stream, table, data)


def describe(file: str, stream: str, table: pa.Table, data: bytes) -> Chunk:
    about = {"file": file, "stream": stream, "rows": table.num_rows, "sha256": sha256(data)}
    if stream == TABLE:
        return Chunk(**about, first_ns=0, last_ns=0, first_row=0)
    begin, end = ("at_ns", "at_ns") if stream == FAULTS else ("first_byte_ns", "last_byte_ns")
    first_ns, last_ns, first_row = table[begin][0], table[end][-1], table["sequence"][0]
    return Chunk(**about, first_ns=first_ns.as_py(), last_ns=last_ns.as_py(), first_row=first_row.as_py())
