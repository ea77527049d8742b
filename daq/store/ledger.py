"""The ledger of a run, `ledger.jsonl`, and the records that it and the manifest are made of: what was recorded, one
line for each record, only ever appended to.

Each line holds the SHA-256 over the one of the line before it and its own content, so that no line can change or go
missing unseen. Whatever follows the last line that verifies is left out: a crash leaves a line half-written. See
docs/decisions/0017-a-run-proves-that-it-is-whole.md.
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
BEING_RECORDED = ("is being recorded", "wait for its end, or end it: rig record stop")
"""What is said of a run that is not ended yet, and what a person does."""
_CHUNK = re.compile(r"(?P<stream>.+)-(?P<number>[0-9]{4,})\.(?P<kind>parquet|arrow)")


def chunk_name(stream: str, number: int) -> str:
    """Return the name of a chunk's Parquet file; chunks count from 1."""
    return f"{stream}-{number:04d}.parquet"


def parse_chunk(name: str) -> tuple[str, int, str] | None:
    """Return stream, number and kind (parquet, arrow) of a chunk's file name; None for any other file."""
    match = _CHUNK.fullmatch(name)
    return (match["stream"], int(match["number"]), match["kind"]) if match else None


class Record(BaseModel):
    """Anything that is stored as JSON: immutable, and refused with a key that it does not know."""

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)


class Clock(Record):
    """The monotonic and the wall clock read together: true to within bracket_ns."""

    monotonic_ns: int
    unix_ns: int
    bracket_ns: Count


class Chunk(Record):
    """One closed chunk; first_ns and last_ns are its first first-byte and last last-byte stamp, 0 in a table."""

    file: str
    stream: Name
    rows: Count
    sha256: str
    first_ns: int
    last_ns: int
    first_row: Count | None = Field(default=None, exclude_if=lambda first: first is None)
    """The number of its first row in the stream; None in a run of version 1."""

    @property
    def number(self) -> int:
        """Its number in the stream, from 1; 0 for a file that is named otherwise."""
        return (parse_chunk(self.file) or ("", 0, ""))[1]


class ImportedTable(Record):
    """The table that a run was imported from: its file, or files with ` + ` between them, and its columns in order."""

    file: Text
    sha256: str
    """SHA-256 of the file as it was read; of several, that of theirs, one after the other."""
    columns: dict[str, ColumnType]
    map: Text = Field(default="", max_length=100_000, exclude_if=lambda text: not text)
    """The map by which it was read, as YAML; empty where its columns are those of docs/tables.md."""
    assumed: tuple[Text, ...] = Field(default=(), max_length=100, exclude_if=lambda words: not words)
    """What the map takes for true without a confirmation, in words."""


class Relabelling(Record):
    """One field of a run's label that a person corrected after its end, and when."""

    at: str
    field: Literal["test", "direction", "operator", "placement"]
    old: Text | None
    new: Text | None


class Seal(Record):
    """How a recording ended, and how much it holds.

    ended: None where nothing says when, because the recording was cut off: what came last may be missing as well.
    rows: of each stream, as many as were handed to the disk. counters: of each stream its samples, and its faults of
    each kind.
    """

    exit_status: Literal["complete", "interrupted", "failed", "recovered"]
    reason: Text
    ended: str | None
    rows: dict[Name, Count]
    counters: dict[str, dict[str, Count]]


def to_recover(run: Path) -> str:
    """Return what a person should do about a run that was cut off or is damaged, as it can be copied into a shell."""
    return f"run `rig recover {as_argument(run)}`"


def no_run(path: Path) -> FileError:
    """Return the error of a path that is no directory. A recorded run's directory begins with its time, so a person who
    gives the name alone is shown the run that ends with it, where there is one."""
    if path.exists():
        return FileError(str(path), "is a file, not the directory of a run", "give the directory of a run")
    try:
        alike = path.parent.glob(f"*_{glob.escape(path.name)}") if path.name else ()
        named = [directory for directory in alike if directory.is_dir()]
    except OSError:
        named = []
    meant = f"did you mean {as_argument(named[0])}?" if len(named) == 1 else "check the path"
    return FileError(str(path), "no such run directory", meant)


def first_error(error: ValidationError) -> str:
    """Return the first error that pydantic reports, in one line."""
    details = error.errors(include_url=False, include_context=False, include_input=False)[0]
    place = ".".join(str(part) for part in details["loc"])
    return " ".join(f"{place} {details['msg']}".split())


def sha256(data: bytes) -> str:
    """Return the SHA-256 of data in hexadecimal."""
    return hashlib.sha256(data).hexdigest()


def iso_now() -> str:
    """Return the present time in UTC as ISO 8601."""
    return clock.wall_time().isoformat(timespec="milliseconds")


LEDGER = "ledger.jsonl"
_MOST_BYTES = 1_000_000_000
"""The largest ledger: some 400 bytes for each chunk, so four million chunks, or a run of years."""
_LINE = re.compile(rb'\{"sha256":"(?P<digest>[0-9a-f]{64})",(?P<rest>.+)\}')


class Entry(Record):
    """One line: exactly one of these is there. opening: SHA-256 of the manifest, in the first line only."""

    opening: str | None = None
    chunk: Chunk | None = None
    anchor: Clock | None = None
    seal: Seal | None = None
    relabelled: tuple[Relabelling, ...] = ()


@dataclass(frozen=True)
class Verified:
    """The lines of a ledger that verify. size: their bytes; last: SHA-256 of the last one; seal: that of the
    last seal, empty without one; unread: bytes after the last one; unread_lines: how many whole lines these hold, none
    where a crash has left one half-written."""

    entries: tuple[Entry, ...] = ()
    size: int = 0
    last: str = ""
    unread: int = 0
    unread_lines: int = 0
    seal: str = ""


def verified(data: bytes) -> Verified:
    """Return the lines of a ledger up to the first that does not verify. Never raises."""
    entries: list[Entry] = []
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
    return Verified(tuple(entries), size, last, len(data) - size, data.count(b"\n", size), seal)


def _content(line: re.Match[bytes]) -> Entry | None:
    with suppress(ValidationError):
        return Entry.model_validate_json(b"{" + line["rest"] + b"}")
    return None


@dataclass(frozen=True)
class Claim:
    """What seals say of a run that no line proves any more: rows of each sample stream, and when it ended; None where
    none says it."""

    rows: Counter[str]
    ended: str | None = None

    def __or__(self, claim: Claim) -> Claim:
        """Return the more that both claim."""
        return Claim(self.rows | claim.rows, self.ended or claim.ended)


def claim_in(data: bytes, opening: str | None) -> Claim:
    """Return what a ledger's seals claim, also in lines that do not verify.

    A seal holds the number of rows twice, as rows and as samples: the smaller counts, so that a damaged digit makes no
    row missing. opening: SHA-256 of the run's manifest; the ledger of another run claims nothing.
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


def line_of(entry: Entry, before: str) -> tuple[bytes, str]:
    """Return an entry as a line that follows the line of this SHA-256 (empty for the first), and its own SHA-256."""
    content = entry.model_dump_json(exclude_defaults=True).encode()
    digest = sha256(before.encode() + content)
    return b'{"sha256":"' + digest.encode() + b'",' + content[1:] + b"\n", digest


def lines_of(entries: Iterable[Entry]) -> bytes:
    """Return a whole ledger."""
    lines, last = [], ""
    for entry in entries:
        line, last = line_of(entry, last)
        lines.append(line)
    return b"".join(lines)


def read_ledger(run: Path) -> Verified:
    """Read the ledger of a run; empty if there is none. Raises OSError, and FileError for anything but a file."""
    try:
        return verified(read_bytes(run / LEDGER, _MOST_BYTES))
    except FileNotFoundError:
        return Verified()


class Ledger:
    """Appends to the ledger of one run. Raises plain OSError."""

    def __init__(self, path: Path, fd: int, size: int, last: str) -> None:
        self.path, self.fd, self._size, self._last = path, fd, size, last

    @property
    def last(self) -> str:
        """The SHA-256 of its last line, which stands for all of it."""
        return self._last

    @classmethod
    def create(cls, run: Path, opening: bytes) -> Ledger:
        """Create the ledger of a run whose manifest holds these bytes, durably."""
        line, last = line_of(Entry(opening=sha256(opening)), "")
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
        """Open the ledger of a run, to go on after its last line that verifies. Raises FileError where whole lines
        follow it, which going on would replace."""
        ledger = read_ledger(run)
        if ledger.unread_lines:
            problem = f"has lines in {LEDGER} that cannot be verified, and going on would replace them"
            raise FileError(str(run), problem, f"{to_recover(run)}, which keeps them")
        return cls(run / LEDGER, durable.reopen(run / LEDGER), ledger.size, ledger.last)

    def append(self, entry: Entry) -> None:
        """Append an entry, durably. What an attempt that failed has left is cut off first."""
        line, digest = line_of(entry, self._last)
        durable.truncate(self.fd, self._size)
        durable.write_at(self.fd, line, self._size)
        durable.sync(self.fd)
        self._size, self._last = self._size + len(line), digest

    def close(self) -> None:
        """Close the file."""
        durable.close(self.fd)
