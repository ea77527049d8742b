"""The recording of a run, from its first row to its exit status.

One thread owns a writer. It appends rows, and calls `sync` about once a second: whatever sync returned
for survives a kill and a power cut. A disk that refuses makes a `CellError` and condemns the writer,
because after a failed fsync nobody knows what is on the disk; what was synced before stays readable,
`close` saves what it still can, and `rig recover` does the rest.
"""

from __future__ import annotations

import os
import re
import shutil
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from itertools import count
from pathlib import Path

import pyarrow as pa

from daq.protocol.conversation import Fault, Sample
from daq.store import durable
from daq.store.chunk import with_opening
from daq.store.manifest import Ending, Manifest, iso_now, new_manifest, read_clocks
from daq.store.recording import Recorder
from daq.store.schema import FAULTS, schema_of
from rigs.errors import CellError
from rigs.vocabulary import Direction, TestName

CHUNK_ROWS = 200_000
"""Closing a chunk of this size holds the writer up for about 0.2 s (7 columns and 6 joints)."""
CHUNK_AGE_NS = 600 * 10**9
"""A slow gauge's rows become Parquet within ten minutes."""
_TIMED = re.compile(r"[0-9]{8}T[0-9]{6}[.0-9]*Z")


@dataclass
class RunWriter:
    """A run being recorded. Made by `create`, ended by `close`."""

    path: Path
    manifest: Manifest
    _recorders: dict[str, Recorder]
    _lock: int
    _chunk_rows: int
    _failure: CellError | None = None

    @classmethod
    def create(  # noqa: PLR0913 - what a manifest needs to know
        cls,
        runs: Path,
        *,
        name: str,
        test: TestName,
        direction: Direction | None,
        rig_name: str,
        rig_text: str,
        operator: str,
        streams: Mapping[str, tuple[str, ...]],
        chunk_rows: int = CHUNK_ROWS,
    ) -> RunWriter:
        """Start a run in a fresh directory `<UTC time>_<name>` under runs, its manifest on the disk.

        A name that begins with a UTC time of its own is the directory's as it is.

        streams: value columns of each sample stream. Raises FileError for names that cannot be used,
        CellError when the disk refuses.
        """
        manifest = new_manifest(
            name=name,
            test=test,
            direction=direction,
            rig_name=rig_name,
            rig_text=rig_text,
            operator=operator,
            streams=streams,
        )
        try:
            path, held = _begin(runs, manifest)
        except OSError as error:
            remedy = "make room or choose another directory"
            raise CellError(str(runs), f"cannot be written: {_words(error)}", remedy) from error
        recorders = {
            stream: Recorder(path, stream, with_opening(schema_of(stream, columns), manifest.opening()))
            for stream, columns in manifest.all_streams.items()
        }
        return cls(path, manifest, recorders, held, chunk_rows)

    def append(self, stream: str, samples: Iterable[Sample]) -> None:
        """Take samples of one stream; they are kept in memory until `write` or `sync`."""
        self._recorders[stream].append(samples)

    def append_faults(self, stream: str, faults: Iterable[Fault]) -> None:
        """Take faults that happened on one stream."""
        self._recorders[FAULTS].append((stream, fault) for fault in faults)

    def anchor(self) -> None:
        """Keep in the manifest what time it is now: the wall clock has been set. Raises CellError."""
        with self._guarded():
            self.manifest = self.manifest.model_copy(update={"anchors": (*self.manifest.anchors, read_clocks())})
            self.manifest.save(self.path)

    def write(self) -> None:
        """Hand everything taken so far to the operating system. Raises CellError."""
        with self._guarded():
            self._write()

    def sync(self) -> None:
        """Write, and return when everything taken so far is on the disk. Raises CellError."""
        with self._guarded():
            self._write()
            for recorder in self._recorders.values():
                recorder.sync()

    def close(self, exit_status: Ending, reason: str, counters: Mapping[str, Mapping[str, int]]) -> None:
        """End the run: close every chunk and say in the manifest how and why it ended.

        Does all it can, lets go of the run, and only then raises CellError for what it could not do.
        """
        steps = [] if self._failure else [self._write]
        steps += [partial(self._roll, recorder) for recorder in self._recorders.values()]
        problems = [problem for step in steps if (problem := _attempt(step))]
        if problems and exit_status != "failed":
            exit_status, reason = "failed", f"{reason}; {_words(problems[0])}".lstrip("; ")
        self.manifest = self.manifest.model_copy(
            update={
                "exit_status": exit_status,
                "reason": reason,
                "ended": iso_now(),
                "counters": {stream: {str(k): n for k, n in counts.items()} for stream, counts in counters.items()},
            }
        )
        problems += [problem] if (problem := _attempt(partial(self.manifest.save, self.path))) else []
        for recorder in self._recorders.values():
            recorder.release()
        os.close(self._lock)
        if problems:
            raise _refused(self.path, problems[0]) from problems[0]

    def _write(self) -> None:
        for recorder in self._recorders.values():
            recorder.write()
            chunk = recorder.open
            if chunk and (chunk.rows >= self._chunk_rows or time.monotonic_ns() - chunk.born_ns >= CHUNK_AGE_NS):
                self._roll(recorder)

    def _roll(self, recorder: Recorder) -> None:
        if recorder.open is None:
            return
        if recorder.open.rows:  # none when the disk refused the first frame
            chunk = recorder.finish()
            manifest = self.manifest.model_copy(update={"chunks": (*self.manifest.chunks, chunk)})
            manifest.save(self.path)
            self.manifest = manifest
        recorder.forget()

    @contextmanager
    def _guarded(self) -> Iterator[None]:
        if self._failure:
            raise self._failure
        try:
            yield
        except (OSError, pa.ArrowException) as error:
            self._failure = _refused(self.path, error)
            raise self._failure from error


def _begin(runs: Path, manifest: Manifest) -> tuple[Path, int]:
    path = _fresh_directory(runs, manifest.name)
    held = durable.lock(path)
    try:
        manifest.save(path)
        durable.sync_directory(runs)
    except OSError:
        os.close(held)
        with suppress(OSError):
            shutil.rmtree(path)  # nothing is recorded in it yet
        raise
    return path, held


def _fresh_directory(runs: Path, name: str) -> Path:
    runs.mkdir(parents=True, exist_ok=True)
    stem = name if _TIMED.match(name) else f"{datetime.now(UTC):%Y%m%dT%H%M%SZ}_{name}"
    for number in count(1):
        path = runs / (stem if number == 1 else f"{stem}.{number}")
        with suppress(FileExistsError):
            path.mkdir()
            return path
    raise AssertionError("count has no end")


def _attempt(step: Callable[[], None]) -> Exception | None:
    try:
        step()
    except (OSError, pa.ArrowException) as error:
        return error
    return None


def _words(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error).partition("\n")[0]


def _refused(run: Path, error: Exception) -> CellError:
    remedy = f"make room or mend the disk; what was synced is safe: `rig recover {run}`"
    return CellError(str(run), f"cannot be written: {_words(error)}", remedy)
