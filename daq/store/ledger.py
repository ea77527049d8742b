"""Ledger of a run, `ledger.jsonl`: an append-only list of records, one per line.

Each line contains the SHA-256 of the previous line and a record, so that a changed or removed line is detected. All
data after the last valid line is ignored (docs/decisions/0017-a-run-proves-that-it-is-whole.md).
"""

from __future__ import annotations

import glob
import hashlib
import re
from collections import Counter
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from daq import clock
from daq.store import durable
from daq.store.chunk import ColumnType, storable
from rigs.errors import FileError
from rigs.files import read_bytes
from rigs.text import as_argument

Ending = Literal["complete", "interrupted", "failed"]
ExitStatus = Literal["recording", "complete", "interrupted", "failed", "recovered"]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]{0,99}$")]
Text = Annotated[str, AfterValidator(storable)]
Count = Annotated[int, Field(ge=0)]
BEING_RECORDED = ("is being recorded", "wait for the end, or end it: rig record stop")
_CHUNK = re.compile(r"(?P<stream>.+)-(?P<number>[0-9]{4,})\.(?P<kind>parquet|arrow)")


def chunk_name(stream: str, number: int) -> str:
    return f"{stream}-{number:04d}.parquet"


def parse_chunk(name: str) -> tuple[str, int, str] | None:
    """Stream, number and kind (parquet, arrow) from the file name of a chunk; None for another file."""
    match = _CHUNK.fullmatch(name)
    return (match["stream"], int(match["number"]), match["kind"]) if match else None


class JsonRecord(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)


class Clock(JsonRecord):
    monotonic_ns: int
    unix_ns: int
    bracket_ns: Count


class Chunk(JsonRecord):
    """A closed chunk with the timestamps of its first and last byte, 0 in a table."""

    file: str
    stream: Name
    rows: Count
    sha256: str
    first_ns: int
    last_ns: int
    first_row: Count | None = Field(default=None, exclude_if=lambda first: first is None)
    """Number of the first row in the stream, None in a run of version 1."""

    @property
    def number(self) -> int:
        """Number in the stream, from 1; 0 if the file is not named like a chunk."""
        return (parse_chunk(self.file) or ("", 0, ""))[1]


class ImportedTable(JsonRecord):
    """Source of an imported run: file, or files joined with ` + `, and the columns in order."""

    file: Text
    sha256: str
    """SHA-256 of the file, or of the concatenation of several files."""
    columns: dict[str, ColumnType]
    map: Text = Field(default="", max_length=100_000, exclude_if=lambda text: not text)
    """Import map as YAML. Empty if the file had the columns of docs/tables.md."""
    assumed: tuple[Text, ...] = Field(default=(), max_length=100, exclude_if=lambda words: not words)
    only_commanded: bool = Field(default=False, exclude_if=lambda only: not only)
    """True if the joint angles are commands, and the file contains no measured angles."""


class Relabelling(JsonRecord):
    at: str
    field: Literal["test", "direction", "operator", "placement"]
    old: Text | None
    new: Text | None


class Seal(JsonRecord):
    """End and size of a recording."""

    exit_status: Literal["complete", "interrupted", "failed", "recovered"]
    reason: Text
    ended: str | None
    """None if the recording was interrupted; the last rows may be missing."""
    rows: dict[Name, Count]
    counters: dict[str, dict[str, Count]]


def to_recover(run: Path) -> str:
    return f"run `rig recover {as_argument(run)}`"


def no_run(path: Path) -> FileError:
    """Error for a path that is not a directory; suggests the recorded run of that name, which begins with the time."""
    if path.exists():
        return FileError(
            str(path), "is a file, not the directory of a run", "give the directory of a run", code="run.missing"
        )
    try:
        alike = path.parent.glob(f"*_{glob.escape(path.name)}") if path.name else ()
        named = [directory for directory in alike if directory.is_dir()]
    except OSError:
        named = []
    meant = f"did you mean {as_argument(named[0])}?" if len(named) == 1 else "check the path; a run is a directory"
    return FileError(str(path), "no such file or directory", meant, code="run.missing")


def first_error(error: ValidationError) -> str:
    details = error.errors(include_url=False, include_context=False, include_input=False)[0]
    place = ".".join(str(part) for part in details["loc"])
    return " ".join(f"{place} {details['msg']}".split())


def sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def iso_now() -> str:
    return clock.wall_time().isoformat(timespec="milliseconds")


LEDGER = "ledger.jsonl"
_MOST_BYTES = 1_000_000_000
"""A chunk needs about 400 bytes, so this is sufficient for four million chunks, or years."""
_LINE = re.compile(rb'\{"sha256":"(?P<digest>[0-9a-f]{64})",(?P<rest>.+)\}')


class LedgerEntry(JsonRecord):
    """A ledger line with exactly one record. opening: SHA-256 of the manifest, in the first line only."""

    opening: str | None = None
    chunk: Chunk | None = None
    anchor: Clock | None = None
    seal: Seal | None = None
    relabelled: tuple[Relabelling, ...] = ()


@dataclass(frozen=True)
class VerifiedLedger:
    """Valid part of a ledger."""

    entries: tuple[LedgerEntry, ...] = ()
    size: int = 0
    last: str = ""
    unread: int = 0
    """Bytes after the last valid line."""
    unread_lines: int = 0
    """Complete lines among them, 0 after a crash."""
    seal: str = ""


def verified(data: bytes) -> VerifiedLedger:
    entries: list[LedgerEntry] = []
    size, last, seal = 0, "", ""
    for line in data.split(b"\n")[:-1]:
        match = _LINE.fullmatch(line)
        if match is None or match["digest"].decode() != sha256(last.encode() + b"{" + match["rest"] + b"}"):
            break
        entry = _content(match)
        if entry is None:
            break
        entries.append(entry)
        size, last = size + len(line) + 1, line[len(b'{"sha256":"') :][:64].decode()
        seal = last if entry.seal else seal
    return VerifiedLedger(tuple(entries), size, last, len(data) - size, data.count(b"\n", size), seal)


def _content(line: re.Match[bytes]) -> LedgerEntry | None:
    with suppress(ValidationError):
        return LedgerEntry.model_validate_json(b"{" + line["rest"] + b"}")
    return None


@dataclass(frozen=True)
class Claim:
    """Content of the seals in unverified lines: rows per sample stream, and the end time."""

    rows: Counter[str]
    ended: str | None = None

    def __or__(self, claim: Claim) -> Claim:
        return Claim(self.rows | claim.rows, self.ended or claim.ended)


def claim_in(data: bytes, opening: str | None) -> Claim:
    """Claims of the seals in a ledger, also in invalid lines. opening: SHA-256 of the manifest of the run.

    A seal contains the row count twice, as rows and as samples. The smaller is used, so that a damaged digit does not
    make rows appear missing.
    """
    ledger, claimed, ended = verified(data), Counter[str](), None
    if ledger.entries and ledger.entries[0].opening != opening:
        return Claim(claimed)
    for line in data.split(b"\n"):
        entry = _content(match) if (match := _LINE.fullmatch(line)) else None
        if entry and entry.seal:
            samples = {stream: counts.get("samples", 0) for stream, counts in entry.seal.counters.items()}
            claimed |= Counter(entry.seal.rows) & Counter(samples)
            ended = entry.seal.ended or ended
    return Claim(claimed, ended)


def line_of(entry: LedgerEntry, before: str) -> tuple[bytes, str]:
    content = entry.model_dump_json(exclude_defaults=True).encode()
    digest = sha256(before.encode() + content)
    return b'{"sha256":"' + digest.encode() + b'",' + content[1:] + b"\n", digest


def lines_of(entries: Iterable[LedgerEntry]) -> bytes:
    lines, last = [], ""
    for entry in entries:
        line, last = line_of(entry, last)
        lines.append(line)
    return b"".join(lines)


def read_ledger(run: Path) -> VerifiedLedger:
    try:
        return verified(read_bytes(run / LEDGER, _MOST_BYTES))
    except FileNotFoundError:
        return VerifiedLedger()


class Ledger:
    def __init__(self, path: Path, fd: int, size: int, last: str) -> None:
        self.path, self.fd, self._size = path, fd, size
        self.last = last
        """SHA-256 of the last line, which covers the complete ledger."""

    @classmethod
    def create(cls, run: Path, opening: bytes) -> Ledger:
        line, last = line_of(LedgerEntry(opening=sha256(opening)), "")
        fd = durable.create(run / LEDGER, line)
        try:
            durable.sync(fd)
            durable.sync_directory(run)
        except OSError:
            durable.close(fd)
            raise
        return cls(run / LEDGER, fd, len(line), last)

    @classmethod
    def resume(cls, run: Path) -> Ledger:
        """Continue after the last valid line. Refuses to overwrite complete lines that follow."""
        ledger = read_ledger(run)
        if ledger.unread_lines:
            problem = f"has lines in {LEDGER} that cannot be verified, and continuing would replace them"
            raise FileError(str(run), problem, f"{to_recover(run)}, which keeps these lines", code="run.damaged")
        return cls(run / LEDGER, durable.reopen(run / LEDGER), ledger.size, ledger.last)

    def append(self, entry: LedgerEntry) -> None:
        """Append an entry durably. Remains of a failed attempt are removed first."""
        line, digest = line_of(entry, self.last)
        durable.truncate(self.fd, self._size)
        durable.write_at(self.fd, line, self._size)
        durable.sync(self.fd)
        self._size, self.last = self._size + len(line), digest

    def close(self) -> None:
        durable.close(self.fd)
