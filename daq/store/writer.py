"""Writer of a run, from the first row to the exit status.

A single thread owns the writer. Slow disk operations are `DiskOperation` for a second thread, one at a time: syncs and
the closing of full chunks. After a `CellError` the writer can no longer be used, because the content of the disk is
unknown after a failed fsync: `close` saves as much as possible, and `rig recover` does the rest. `NearlyFull` is raised
earlier: the run can still be closed completely.
"""

from __future__ import annotations

import os
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import pyarrow as pa

from daq import clock
from daq.protocol.conversation import Fault, FaultKind, Sample
from daq.store import durable
from daq.store.chunk import FAULTS, schema_of, with_opening
from daq.store.ledger import Clock, Ending, Ledger, LedgerEntry, Seal, iso_now
from daq.store.manifest import Manifest, clock_now
from daq.store.run_directory import (
    MARGIN_BYTES,
    RunRemoved,
    create_run_directory,
    give_back,
    require_files,
    require_room,
)
from daq.store.stream_writer import StreamWriter
from rigs.errors import CellError
from rigs.text import as_argument

CHUNK_ROWS = 200_000
"""Rows of a full chunk. Closing it takes about 0.2 s (7 columns and 6 joints)."""
CHUNK_AGE_NS = 600 * 10**9
"""Age of a full chunk: the rows of a slow gauge are stored as Parquet within ten minutes."""
MOST_PENDING = 100_000
"""Pending rows per stream while the previous chunk is being stored: minutes at 500 Hz."""


@dataclass(frozen=True)
class DiskOperation:
    steps: Sequence[Callable[[], None]]
    synced: Mapping[str, int] | None = None
    """Rows per sample stream on the disk after it."""

    def wait(self) -> None:
        errors = [error for step in self.steps if (error := _attempt(step))]
        if errors:
            raise errors[0]


@dataclass
class RunWriter:
    path: Path
    manifest: Manifest
    _writers: dict[str, StreamWriter]
    _lock: int
    _ledger: Ledger
    """Ledger; only `DiskOperation` and `close` append to it."""
    device: int
    _chunk_rows: int
    _failure: CellError | None = None
    _anchors: deque[Clock] = field(default_factory=deque)
    seal: str = ""
    """After `close`: SHA-256 of the seal, which covers all data of the run."""
    lost: Counter[str] = field(default_factory=Counter)
    """After `close`: number of unsaved samples per stream, including drops with unsaved counts."""

    @classmethod
    def create(
        cls,
        runs: Path,
        manifest: Manifest,
        *,
        companions: Mapping[str, bytes] | None = None,
        chunk_rows: int = CHUNK_ROWS,
    ) -> RunWriter:
        """Start a run in `<UTC time>_<name>` under runs, with manifest and ledger on the disk.

        A name that starts with a UTC time is used unchanged. companions: content of the files next to the rig file, by
        name.
        """
        try:
            path, lock, ledger = create_run_directory(runs, manifest, companions or {})
        except OSError as error:
            remedy = durable.remedy(error, "make room or choose a different directory")
            raise CellError(
                str(runs), f"cannot be written: {_words(error)}", remedy, code="output.not_writable"
            ) from error
        writers = {
            stream: StreamWriter(path, stream, with_opening(schema_of(stream, columns), manifest.opening()))
            for stream, columns in manifest.all_streams.items()
        }
        return cls(path, manifest, writers, lock, ledger, os.fstat(lock).st_dev, chunk_rows)

    def append(self, stream: str, samples: Iterable[Sample]) -> None:
        """Append samples of a stream. They remain in memory until `write` or `sync`."""
        self._writers[stream].append(samples)

    def append_faults(self, stream: str, faults: Iterable[Fault]) -> None:
        self._writers[FAULTS].append((stream, fault) for fault in faults)

    def is_behind(self, stream: str) -> bool:
        return max(len(self._writers[name].pending) for name in (stream, FAULTS)) >= MOST_PENDING

    def stored(self) -> dict[str, int]:
        """Rows per sample stream written to the operating system. They are on the disk after a sync."""
        return {stream: self._writers[stream].rows for stream in self.manifest.streams}

    def room_to_close(self) -> int:
        """Bytes needed at most to close the run."""
        chunks = sum(writer.bytes_to_close() for writer in self._writers.values())
        # The opening manifest is in the head of a chunk once, and in the Parquet file three times.
        return chunks + 4 * len(self._writers) * len(self.manifest.opening())

    def anchor(self) -> None:
        """Store both clocks after a step of the wall clock. The next sync saves them."""
        self._anchors.append(clock_now())

    def write(self) -> None:
        """Write all rows to the operating system, where they survive the end of the process.

        Raises NearlyFull before writing if there would not be enough space to close, RunRemoved if the directory is
        gone, and CellError for other failures.
        """
        with self._guarded():
            chunks = {chunk.path: chunk.fd for writer in self._writers.values() if (chunk := writer.open)}
            require_files(self.path, {self._ledger.path: self._ledger.fd, **chunks})
            require_room(self.path, self.room_to_close() + MARGIN_BYTES)
            self._write()

    def begin_sync(self) -> DiskOperation:
        """Operation that syncs all written rows. Full or old chunks are ended and synced first."""
        with self._guarded():
            for writer in self._writers.values():
                chunk = writer.open
                if chunk is None or writer.full:
                    continue
                if chunk.rows >= self._chunk_rows or clock.now_ns() - chunk.born_ns >= CHUNK_AGE_NS:
                    chunk.end()
            syncs = [sync for writer in self._writers.values() if (sync := writer.begin_sync())]
            syncs.sort(key=lambda sync: not sync.chunk.ended)  # the next rows of these chunks are waiting
            anchored = [self._save_anchors] if self._anchors else []
            return DiskOperation([*(sync.wait for sync in syncs), *anchored], self.stored())

    def begin_roll(self) -> DiskOperation | None:
        """Operation that closes the oldest ended and synced chunk: only one, because no syncs take place meanwhile."""
        full = [(chunk.born_ns, name) for name, writer in self._writers.items() if (chunk := writer.full)]
        return DiskOperation([partial(self._roll, self._writers[min(full)[1]]), give_back]) if full else None

    def end_work(self, error: BaseException | None) -> None:
        with self._guarded():
            if error:
                raise error

    def close(self, exit_status: Ending, reason: str, counters: Mapping[str, Mapping[str, int]]) -> None:
        """End the run: close all chunks, and seal the ledger with status and reason, when no operation is pending.

        counters: faults by stream and kind; sample counts are set to the stored rows. All steps are attempted, and the
        run is released, before a CellError is raised.
        """
        steps = [] if self._failure else [self._write]
        steps += [partial(self._end, writer) for writer in self._writers.values()]
        steps += [self._save_anchors, partial(durable.sync_directory, self.path), give_back]
        problems = [problem for step in steps if (problem := _attempt(step))]
        if problems and exit_status != "failed":
            exit_status, reason = "failed", f"{reason}; {_words(problems[0])}".lstrip("; ")
        rows = {stream: writer.rows for stream, writer in self._writers.items()}
        stored = {stream: {"samples": count} for stream, count in rows.items()}
        counted = {
            stream: {str(kind): count for kind, count in counts.items()} | stored.get(stream, {})
            for stream, counts in counters.items()
        }
        seal = Seal(exit_status=exit_status, reason=reason, ended=iso_now(), rows=rows, counters=counted)
        if unsealed := _attempt(partial(self._ledger.append, LedgerEntry(seal=seal))):
            problems.append(unsealed)
        else:
            self.seal = self._ledger.last
        sealed = not unsealed
        self.lost.update({stream: self._writers[stream].count_lost_rows() for stream in self.manifest.streams})
        for row in [] if sealed else self._writers[FAULTS].pending:  # recovery counts the stored faults
            if isinstance(row, tuple) and row[1].kind is FaultKind.DROPPED:
                self.lost[row[0]] += row[1].count
        for writer in self._writers.values():
            writer.release()
        self._ledger.close()
        durable.close(self._lock)
        if problems:
            raise _refused(self.path, problems[0]) from problems[0]

    def _write(self) -> None:
        for writer in self._writers.values():
            writer.write()

    def _end(self, writer: StreamWriter) -> None:
        while writer.unclosed():
            self._roll(writer)
            if not self._failure:
                writer.write()

    def _roll(self, writer: StreamWriter) -> None:
        chunk = writer.unclosed()[0]
        if chunk.rows:  # empty if the disk refused the first frame
            self._ledger.append(LedgerEntry(chunk=writer.finish(chunk)))
        writer.delete_chunk(chunk)

    def _save_anchors(self) -> None:
        while self._anchors:
            self._ledger.append(LedgerEntry(anchor=self._anchors[0]))
            self._anchors.popleft()

    @contextmanager
    def _guarded(self) -> Iterator[None]:
        if self._failure:
            raise self._failure
        try:
            yield
        except (OSError, pa.ArrowException) as error:
            self._failure = _refused(self.path, error)
            raise self._failure from error


def _attempt(step: Callable[[], None]) -> Exception | None:
    try:
        step()
    except (OSError, pa.ArrowException) as error:
        return error
    return None


def _words(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error).partition("\n")[0]


def _refused(run: Path, error: Exception) -> CellError:
    if isinstance(error, FileNotFoundError):
        return RunRemoved(run)
    remedy = durable.remedy(error, "free some space or repair the disk")
    safe = f"all synced data are safe: `rig recover {as_argument(run)}`"
    return CellError(str(run), f"cannot be written: {_words(error)}", f"{remedy}; {safe}", code="output.not_writable")
