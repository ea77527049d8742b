"""Manifest of a run, `manifest.json`, written once at the start. Later events are in the ledger.

A run without a seal that no process has locked is the result of a crash. In runs of version 1 the manifest contained
all data and was rewritten at each change.
"""

from __future__ import annotations

import errno
import platform
import socket
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import pyarrow as pa
from pydantic import AfterValidator, Field, ValidationError, model_validator

from daq.acquisition.host_clock import read_clocks
from daq.store.chunk import FAULTS, SAMPLE_COLUMNS, TABLE, schema_of, storable, table_schema
from daq.store.durable import replace
from daq.store.ledger import (
    LEDGER,
    Chunk,
    Clock,
    Count,
    ExitStatus,
    ImportedTable,
    JsonRecord,
    LedgerEntry,
    Name,
    Relabelling,
    Text,
    first_error,
    iso_now,
    no_run,
    parse_chunk,
    read_ledger,
    sha256,
    to_recover,
)
from rigs.distribution import version
from rigs.errors import FileError, UseError
from rigs.files import of_newer_rig, read_bytes
from rigs.schema.part import Length
from rigs.schema.vocabulary import Direction, TestName

MANIFEST = "manifest.json"
OF_A_RUN = frozenset({MANIFEST, LEDGER})
"""Files that identify a directory as a run, even if it is damaged."""
_IN_LEDGER = {"chunks", "anchors", "rows", "counters", "exit_status", "reason", "ended", "relabelled"}
"""Fields that are derived from the ledger in a run of version 2."""
_LONGEST_OPERATOR = 200
"""Characters, sufficient for names of people and shifts, but not for a pasted page."""
_MOST_BYTES = 100_000_000
"""In version 1 a chunk needed 250 bytes, and a month of recording had 10 000 chunks."""
_RIG_VERSION = version()  # read at import because it opens files; a recording may start when no file can be opened


def operator_name(text: str) -> str:
    """Name of an operator in stored form. Raises ValueError for control characters or excessive length."""
    text = storable(text)
    if len(text) > _LONGEST_OPERATOR:
        raise ValueError(f"the name has {len(text)} characters; write at most {_LONGEST_OPERATOR}")
    if not text.isprintable():
        raise ValueError(f"{text!r} contains control characters; write one line")
    return text


def check_operator(name: str) -> str:
    try:
        return operator_name(name)
    except ValueError as error:
        problem, _, remedy = str(error).rpartition("; ")
        raise UseError("--operator", problem, remedy, code="usage") from None


Operator = Annotated[Text, AfterValidator(operator_name)]
"""Manifests of older runs may contain any text."""
Placement = Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]{0,64}$")]
"""Location of instrument or ball. Runs with the same placement share a set-up."""
ViewZero = tuple[Length, Length]
"""Zero offsets of the live view at the start of the run. For information only: the rows are unmodified."""
DrivenWith = Literal["", "targets", "entries"]
"""Correction that is active during the run: corrected targets, or values entered at the controller.

Such runs show the effect of the correction; the arm itself is unchanged.
"""
PLACEMENT_RULE = "name a placement with up to 64 letters, digits, . _ and -"


class Manifest(JsonRecord):
    version: Literal[1, 2] = 2
    name: Name
    test: TestName
    direction: Direction | None
    rig_name: str
    rig_text: str
    rig_sha256: str
    operator: Text
    placement: Placement = Field(default="", exclude_if=lambda placement: not placement)
    corrected: DrivenWith = Field(default="", exclude_if=lambda by: not by)
    view_zero_mm: ViewZero | None = Field(default=None, exclude_if=lambda zero: zero is None)
    follows: str = ""
    """Directory of the previous run, if the disk or the length limit ended it and this run continues it."""
    host: str
    software: dict[str, str]
    clock: Clock
    anchors: tuple[Clock, ...] = Field(default=(), exclude_if=lambda anchors: not anchors)
    """Both clocks, read again after each suspend and each step of the wall clock."""
    started: str
    ended: str | None = None
    streams: dict[Name, tuple[str, ...]]
    """Value columns of each sample stream, in order."""
    table: ImportedTable | None = None
    chunks: tuple[Chunk, ...] = ()
    rows: dict[Name, Count] = Field(default={}, exclude_if=lambda rows: not rows)
    """Number of rows of each stream written to the disk, from the seal. Empty if there is no seal."""
    counters: dict[str, dict[str, Count]] = Field(default={})
    exit_status: ExitStatus = "recording"
    reason: str = ""
    relabelled: tuple[Relabelling, ...] = Field(default=(), exclude_if=lambda history: not history)
    """Earlier label values, in order of the changes. The label fields contain the current values."""

    @model_validator(mode="after")
    def _consistent(self) -> Manifest:
        if FAULTS in self.streams:
            raise ValueError(f"{FAULTS} cannot be the name of a sample stream")
        for stream, columns in self.streams.items():
            if len({*columns, *SAMPLE_COLUMNS}) < len(columns) + len(SAMPLE_COLUMNS):
                raise ValueError(f"stream {stream} has two columns of the same name")
        if self.table and self.streams:
            raise ValueError("a run is either recorded or imported")
        for chunk in self.chunks:
            name = parse_chunk(chunk.file)
            if name is None or name[0] != chunk.stream or chunk.stream not in self.all_streams:
                raise ValueError(f"{chunk.file!r} does not belong to a stream of this run")
        if len({chunk.file for chunk in self.chunks}) < len(self.chunks):
            raise ValueError("a chunk is listed twice")
        return self

    @property
    def all_streams(self) -> dict[str, tuple[str, ...]]:
        table = {TABLE: tuple(self.table.columns)} if self.table else {}
        return {**self.streams, **table, FAULTS: ()}

    def arrow_schema(self, stream: str) -> pa.Schema:
        if self.table and stream == TABLE:
            return table_schema(self.table.columns)
        return schema_of(stream, self.all_streams[stream])

    def chunks_of(self, stream: str) -> tuple[Chunk, ...]:
        mine = (chunk for chunk in self.chunks if chunk.stream == stream)
        return tuple(sorted(mine, key=lambda chunk: chunk.number))

    def wall_ns(self, monotonic_ns: int) -> int:
        before = bisect_right(self.anchors, monotonic_ns, key=lambda anchor: anchor.monotonic_ns)
        anchor = self.anchors[before - 1] if before else self.clock
        return anchor.unix_ns + monotonic_ns - anchor.monotonic_ns

    @property
    def is_sealed(self) -> bool:
        """True if a ledger proves that the run is complete and unchanged since the end."""
        return self.version > 1 and self.exit_status != "recording"

    def updated(self, **changes: Any) -> Manifest:
        return Manifest.model_validate(self.model_dump() | changes)

    def with_entries(self, entries: Sequence[LedgerEntry]) -> Manifest:
        history = [change for entry in entries for change in entry.relabelled]
        seal = next((entry.seal for entry in reversed(entries) if entry.seal), None)
        return self.updated(
            chunks=tuple({entry.chunk.file: entry.chunk for entry in entries if entry.chunk}.values()),
            anchors=tuple(entry.anchor for entry in entries if entry.anchor),
            relabelled=tuple(history),
            **{change.field: change.new for change in history},
            **(dict(seal) if seal else {}),
        )

    def save(self, run: Path) -> None:
        replace(run / MANIFEST, self.to_json() if self.version == 1 else self.opening())

    def opening(self) -> bytes:
        """Manifest as it was written at the start of the run."""
        if self.version > 1:
            return self.model_dump_json(indent=1, exclude=_IN_LEDGER).encode()
        fresh: dict[str, object] = {
            "chunks": (),
            "anchors": (),
            "counters": {},
            "exit_status": "recording",
            "reason": "",
            "ended": None,
        }
        return self.model_copy(update=fresh).to_json()

    def to_json(self) -> bytes:
        return self.model_dump_json(indent=1).encode()


def new_manifest(*, rig_text: str, streams: Mapping[str, tuple[str, ...]], **facts: Any) -> Manifest:
    try:
        return Manifest(
            **facts,
            rig_text=rig_text,
            rig_sha256=sha256(rig_text.encode("utf-8", "surrogatepass")),
            host=socket.gethostname(),
            software={"rig": _RIG_VERSION, "python": platform.python_version(), "pyarrow": pa.__version__},
            clock=clock_now(),
            started=iso_now(),
            streams=dict(streams),
        )
    except ValidationError as error:
        name = facts.get("name")
        raise FileError(f"run {name!r}", first_error(error), "choose other names", code="output.invalid") from None


class UnknownTestError(FileError):
    """The test belongs to a package that is not installed. The run needs no repair."""


def is_run(path: Path) -> bool:
    """True if a directory is a run, even if damaged. A ledger suffices."""
    return any((path / name).exists() for name in OF_A_RUN)


def load_manifest(run: Path) -> Manifest:
    path = run / MANIFEST
    try:
        if not run.is_dir():
            raise no_run(run)
        data = read_bytes(path, _MOST_BYTES)
        manifest = Manifest.model_validate_json(data)
        if manifest.version == 1:
            return manifest
        entries = read_ledger(run).entries
        if entries and entries[0].opening != sha256(data):
            problem = f"has changed since the start of the run: {LEDGER} contains a different SHA-256"
            raise FileError(str(path), problem, f"{to_recover(run)} or restore the file", code="run.damaged")
        return manifest.with_entries(entries)
    except FileNotFoundError:
        if any(run.glob(f"*/{MANIFEST}")):
            raise FileError(
                str(run),
                "is not a run but a directory of runs",
                f"give a run, such as {run}/NAME",
                code="run.missing",
            ) from None
        if not any(parse_chunk(file.name) for file in run.iterdir()):
            raise FileError(str(run), "contains no run", "give the directory of a run", code="run.missing") from None
        raise FileError(str(run), "has no manifest.json", to_recover(run), code="run.damaged") from None
    except ValidationError as error:
        if newer := of_newer_rig(str(path), error) or _of_another_package(path, error):
            raise newer from None
        problem = f"is damaged or of a different version: {first_error(error)}"
        raise FileError(str(path), problem, f"{to_recover(run)} or restore the file", code="run.damaged") from None
    except OSError as error:
        raise unreadable(path, error) from None


def _of_another_package(path: Path, error: ValidationError) -> UnknownTestError | None:
    (first, *others) = error.errors(include_url=False, include_context=False)
    if others or first["loc"] != ("test",) or not isinstance(first["input"], str):
        return None
    problem = f"uses the test {first['input'][:60]!r}, which is in neither rig nor an installed package"
    return UnknownTestError(
        str(path),
        problem,
        "install the package of the test, or use the run on the original computer",
        code="package.missing",
    )


def unreadable(path: Path, error: OSError) -> FileError:
    short = error.errno == errno.ENOMEM
    remedy = (
        "close other programs, or read it on a different computer" if short else "check the disk and the permissions"
    )
    return FileError(str(path), f"cannot be read: {error.strerror}", remedy, code="file.unreadable")


def clock_now() -> Clock:
    now = read_clocks()
    return Clock(monotonic_ns=now.monotonic_ns, unix_ns=now.wall_ns, bracket_ns=now.bracket_ns)
