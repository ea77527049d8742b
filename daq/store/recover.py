"""Recovery of a run that was not closed, after a crash, a kill, a full disk or a power cut.

A recording chunk is deleted only if all bytes are in a Parquet file listed in the ledger; a damaged one is preserved as
`<file>.torn`. `recover` can start from the state after any step. A run of version 1 receives a ledger.
"""

from __future__ import annotations

import errno
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import chain, count
from pathlib import Path

import pyarrow as pa
from pydantic import ValidationError

from daq.store import durable
from daq.store.chunk import FAULTS, MOST_BYTES, from_parquet, opening_in, salvage, with_opening
from daq.store.ledger import (
    BEING_RECORDED,
    LEDGER,
    Chunk,
    Claim,
    Ledger,
    LedgerEntry,
    Seal,
    chunk_name,
    claim_in,
    lines_of,
    no_run,
    parse_chunk,
    read_ledger,
    sha256,
)
from daq.store.manifest import MANIFEST, Manifest, UnknownTestError, load_manifest
from daq.store.run import left_over, read_chunk
from daq.store.stream_writer import describe, store_chunk
from rigs.errors import CellError, FileError
from rigs.files import read_bytes

TORN = ".torn"


@dataclass
class Recovery:
    path: Path
    rows: dict[str, int] = field(default_factory=dict)
    """Recovered rows by stream."""
    losses: dict[str, str] = field(default_factory=dict)
    """Unreadable data of each damaged file."""
    notes: list[str] = field(default_factory=list)

    @property
    def nothing_to_do(self) -> bool:
        return not (self.rows or self.losses or self.notes)


def recover(path: Path) -> Recovery:
    """Recover an interrupted run, with exit status `recovered`. Refuses a run that is being recorded."""
    try:
        if not path.is_dir():
            raise no_run(path)
        lock = durable.try_lock(path)
        if lock is None:
            raise FileError(str(path), *BEING_RECORDED, code="run.in_use")
        try:
            return _repaired(path)
        finally:
            durable.close(lock)
    except (OSError, pa.ArrowException) as error:
        reason, file = getattr(error, "strerror", None), getattr(error, "filename", None)
        # The operating system reports some files only by number.
        words = f"{reason}: {file!r}" if reason and isinstance(file, str) else str(reason or error)
        remedy = {errno.ENOMEM: "use a computer with more memory", errno.EFBIG: "move that file elsewhere"}.get(
            getattr(error, "errno", None) or 0, durable.remedy(error, "free some space or repair the disk, then retry")
        )
        raise CellError(
            str(path), f"cannot be recovered: {words}", f"{remedy}; no data were lost", code="run.damaged"
        ) from error


def _repaired(path: Path) -> Recovery:
    done = Recovery(path)
    manifest = _manifest_of(path, done)
    opening = manifest.opening()
    manifest = _with_sound_ledger(path, manifest, done)
    if done.nothing_to_do and manifest.exit_status != "recording" and not left_over(path, manifest):
        return done
    ledger = Ledger.resume(path)
    try:
        return _Repair(path, manifest, opening, ledger, done).run()
    finally:
        ledger.close()


def _manifest_of(path: Path, done: Recovery) -> Manifest:
    with suppress(FileNotFoundError):
        read_bytes(path / MANIFEST, MOST_BYTES)  # a manifest that the disk refuses to read is not missing or damaged
    try:
        return load_manifest(path)
    except UnknownTestError:
        raise
    except FileError as error:
        opening = _opening_in(path)
        if opening is None:
            problem = f"{error.what}; and all chunks with a description of the run are missing"
            raise FileError(error.where, problem, "restore manifest.json from a copy", code="run.damaged") from None
    entries = read_ledger(path).entries
    for file, spoilt in ((MANIFEST, True), (LEDGER, bool(entries) and entries[0].opening != sha256(opening))):
        if spoilt and (path / file).exists():
            durable.rename(path / file, _torn_name(path / file))
    durable.replace(path / MANIFEST, opening)
    done.notes.append("manifest.json was missing or damaged: rebuilt from a chunk")
    return load_manifest(path)


def _with_sound_ledger(path: Path, manifest: Manifest, done: Recovery) -> Manifest:
    ledger = read_ledger(path)
    if manifest.version > 1 and ledger.entries:
        if ledger.unread:
            torn, data = _torn_name(path / LEDGER), (path / LEDGER).read_bytes()
            durable.replace(torn, data)
            durable.replace(path / LEDGER, data[: ledger.size])
            done.notes.append(f"{LEDGER}: {ledger.unread} bytes at the end cannot be verified; kept as {torn.name}")
        return manifest
    if manifest.version == 1 and manifest.exit_status != "recording" and not left_over(path, manifest):
        return manifest
    if manifest.version > 1 and (path / LEDGER).exists():
        durable.rename(path / LEDGER, _torn_name(path / LEDGER))
    upgraded = manifest.updated(version=2)
    history = [LedgerEntry(relabelled=upgraded.relabelled)] if upgraded.relabelled else []
    chunks = [LedgerEntry(chunk=chunk) for chunk in upgraded.chunks]
    anchors = [LedgerEntry(anchor=anchor) for anchor in upgraded.anchors]
    durable.replace(
        path / LEDGER, lines_of([LedgerEntry(opening=sha256(upgraded.opening())), *history, *chunks, *anchors])
    )
    upgraded.save(path)
    done.notes.append(f"{LEDGER}: created, because a readable ledger was missing")
    return upgraded


def _opening_in(path: Path) -> bytes | None:
    for file in sorted(path.iterdir()):
        if parse_chunk(file.name) and (opening := opening_in(read_bytes(file, MOST_BYTES))):
            with suppress(ValidationError):
                Manifest.model_validate_json(opening)
                return opening
    return None


@dataclass
class _Repair:
    """A repair in progress. opening: manifest according to the chunks."""

    path: Path
    manifest: Manifest
    opening: bytes
    ledger: Ledger
    done: Recovery

    def run(self) -> Recovery:
        for file in sorted(self.path.iterdir()):
            if file.name.endswith(durable.TEMPORARY):
                durable.remove(file)
                self.done.notes.append(f"{file.name}: half-written, removed")
        # The second glob runs after the recording chunks are settled, which creates Parquet files.
        for file in chain.from_iterable(sorted(self.path.glob(f"*.{kind}")) for kind in ("arrow", "parquet")):
            stream, number, kind = parse_chunk(file.name) or ("", 0, "")
            if stream not in self.manifest.all_streams:
                self._set_aside(file, "belongs to no stream of this run")
            elif kind == "arrow":
                self._settle(file, stream, number)
            elif all(chunk.file != file.name for chunk in self.manifest.chunks):
                if chunk := self._closed(stream, number):
                    self._list(chunk)
                else:
                    self._set_aside(file, "not a chunk of this run, or damaged")
        if self.manifest.exit_status == "recording" or not self.done.nothing_to_do:
            self._seal()
        return self.done

    def _settle(self, file: Path, stream: str, number: int) -> None:
        schema = with_opening(self.manifest.arrow_schema(stream), self.opening)
        salvaged = salvage(read_bytes(file, MOST_BYTES), schema)
        chunk = self._closed(stream, number)
        if (chunk.rows if chunk else 0) < salvaged.rows:
            broken = self.path / chunk_name(stream, number)
            if broken.exists():
                self._set_aside(broken, "damaged, rebuilt from the recording chunk")
            chunk = store_chunk(self.path, stream, number, salvaged, schema)
        if chunk:
            self._list(chunk)
        if salvaged.damage:
            unread = f"{salvaged.unread} bytes could not be read, {salvaged.damage}"
            self._set_aside(file, f"{unread}; {salvaged.rows} rows before them are safe")
        else:
            durable.remove(file)
            durable.sync_directory(self.path)
            self.done.notes.append(f"{file.name}: complete, {salvaged.rows} rows")

    def _closed(self, stream: str, number: int) -> Chunk | None:
        file = self.path / chunk_name(stream, number)
        data = read_bytes(file, MOST_BYTES) if file.exists() else b""
        listed = next((c for c in self.manifest.chunks if c.file == file.name), None)
        if listed:
            return listed if sha256(data) == listed.sha256 else None
        try:
            table = from_parquet(data)
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(file)) from error
        if table is None or not table.num_rows or not table.schema.equals(self.manifest.arrow_schema(stream)):
            return None
        return describe(file.name, stream, table, data)

    def _list(self, chunk: Chunk) -> None:
        others = tuple(c for c in self.manifest.chunks if c.file != chunk.file)
        if chunk not in self.manifest.chunks:
            self.done.rows[chunk.stream] = self.done.rows.get(chunk.stream, 0) + chunk.rows
            self.ledger.append(LedgerEntry(chunk=chunk))
            self.manifest = self.manifest.model_copy(update={"chunks": (*others, chunk)})

    def _set_aside(self, file: Path, why: str) -> None:
        torn = _torn_name(file)
        durable.rename(file, torn)
        durable.sync_directory(self.path)
        self.done.losses[file.name] = f"{why}; kept as {torn.name}"

    def _seal(self) -> None:
        was, entries, claimed = self.manifest, read_ledger(self.path).entries, Claim(Counter())
        for torn in self.path.glob(f"{LEDGER}{TORN}*"):  # preserves the claims if interrupted
            claimed |= claim_in(read_bytes(torn, MOST_BYTES), entries[0].opening if entries else None)
        row_counts = {stream: self._rows(stream) for stream in self.manifest.all_streams}
        counters = {stream: dict(counts) for stream, counts in (was.counters or self._count()).items()}
        for stream in row_counts.keys() & counters.keys():
            counters[stream]["samples"] = sum(chunk.rows for chunk in was.chunks_of(stream))
        seal = Seal(
            exit_status="recovered",
            reason="the recording crashed" if was.exit_status == "recording" else was.reason,
            ended=was.ended or claimed.ended,
            rows={
                stream: max(rows, was.rows.get(stream, 0), claimed.rows[stream]) for stream, rows in row_counts.items()
            },
            counters=counters,
        )
        self.ledger.append(LedgerEntry(seal=seal))
        self.done.notes.append(f"{LEDGER}: sealed as recovered")

    def _rows(self, stream: str) -> int:
        end = 0
        for chunk in self.manifest.chunks_of(stream):
            end = chunk.rows + (end if chunk.first_row is None else chunk.first_row)
        return end

    def _count(self) -> dict[str, dict[str, int]]:
        counts = {
            stream: Counter(samples=sum(chunk.rows for chunk in self.manifest.chunks_of(stream)))
            for stream in self.manifest.all_streams
            if stream != FAULTS
        }
        for chunk in self.manifest.chunks_of(FAULTS):
            with suppress(FileError):
                for row in read_chunk(self.path, chunk, self.manifest.arrow_schema(FAULTS)).to_pylist():
                    counts.setdefault(row["stream"], Counter())[row["kind"]] += row["count"]
        return {stream: dict(count) for stream, count in counts.items()}


def _torn_name(file: Path) -> Path:
    names = (file.with_name(f"{file.name}{TORN}{number or ''}") for number in count())
    return next(name for name in names if not name.exists())
