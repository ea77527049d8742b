"""The records that a run's manifest and ledger are made of, and the words that they use."""

from __future__ import annotations

import glob
import hashlib
import re
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from daq import clock
from daq.store.schema import ColumnType, storable
from rigs.errors import FileError
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
