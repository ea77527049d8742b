"""Verification that a run is complete: comparison of manifest and ledger with the files."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pyarrow as pa

from daq.store import durable
from daq.store.chunk import FAULTS, TABLE
from daq.store.ledger import BEING_RECORDED, LEDGER, VerifiedLedger, read_ledger, sha256, to_recover
from daq.store.manifest import Manifest, load_manifest, unreadable
from daq.store.marks import load_marks
from daq.store.run import read_chunk, unsealed_parts
from rigs.calibration import CALIBRATION, MOST_CALIBRATION_BYTES
from rigs.errors import FileError
from rigs.files import read_bytes

END_UNKNOWN = "before the end, which was never sealed: rows after the last one may be missing"


@dataclass(frozen=True)
class MissingRows:
    stream: str
    first: int
    rows: int

    def __str__(self) -> str:
        if self.rows == 1:
            return f"row {self.first} of {self.stream} is missing"
        return f"rows {self.first} to {self.first + self.rows - 1} of {self.stream} are missing"


@dataclass(frozen=True)
class VerificationResult:
    path: Path
    is_sealed: bool = False
    is_recovered: bool = False
    end_known: bool = True
    """False if the end of the run is not recorded: the last rows may be missing."""
    seal: str = ""
    gaps: tuple[MissingRows, ...] = ()
    problems: tuple[str, ...] = ()

    @property
    def lines(self) -> list[str]:
        """All defects, one line each. Empty for a complete run."""
        return [*self.problems, *(f"{self.path}: {gap}" for gap in self.gaps)]

    @property
    def summary(self) -> str:
        """Path and state of the run, such as `runs/a: whole`."""
        missing = sum(gap.rows for gap in self.gaps)
        if self.problems or (missing and not self.is_recovered):
            return f"{self.path}: not whole"
        sealed = "" if self.is_sealed else "; sealed: no, the run was recorded by an older version"
        if self.is_recovered:
            end = "" if self.end_known else f" {END_UNKNOWN}"
            return f"{self.path}: recovered: {missing or 'no'} rows are known to be missing{end}{sealed}"
        return f"{self.path}: whole{sealed}"


@dataclass
class _Stream:
    name: str
    rows_read: int = 0
    end: int = 0
    gaps: list[MissingRows] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    faults: Counter[tuple[str, str]] = field(default_factory=Counter)

    def skip_to(self, row: int) -> None:
        if row > self.end:
            self.gaps.append(MissingRows(self.name, self.end, row - self.end))
        self.end = row


def verify(path: Path) -> list[str]:
    """Defects of a run, one line each. Empty for a complete run."""
    return judge(path).lines


def judge(path: Path) -> VerificationResult:
    """Verify that a run is complete, reading every byte.

    Each chunk must be present, unchanged and as declared; no row missing or repeated; rows and faults as counted at the
    end of the run; no other files; and the ledger sealed.
    """
    try:
        manifest = load_manifest(path)
        verified = read_ledger(path)
    except OSError as error:
        return VerificationResult(path, problems=(str(unreadable(path / LEDGER, error)),))
    except FileError as error:
        return VerificationResult(path, problems=(str(error),))
    streams = [_read(path, manifest, stream) for stream in manifest.all_streams]
    problems = [problem for stream in streams for problem in stream.problems]
    recovered = manifest.exit_status == "recovered"
    is_recorded = manifest.exit_status == "recording" and durable.may_be_locked(path)
    # During recording, a chunk is added to the ledger when it is full.
    unsealed = [] if is_recorded else unsealed_parts(path, manifest, verified)
    if not problems:  # an unreadable chunk explains all differences of counts
        problems = _counters(path, manifest, {stream.name: stream for stream in streams})
    return VerificationResult(
        path,
        manifest.is_sealed,
        recovered,
        not recovered or manifest.ended is not None,
        verified.seal,
        tuple(gap for stream in streams for gap in stream.gaps),
        (
            *_records(path, manifest, verified, is_recorded=is_recorded), *_companion_problems(path, manifest),
            *unsealed, *problems,
        ),
    )  # fmt: skip


def _records(path: Path, manifest: Manifest, verified: VerifiedLedger, *, is_recorded: bool) -> list[str]:
    """Defects of ledger and manifest, including a missing table of an imported run."""
    problems = []
    if manifest.version > 1 and not verified.entries:
        problems.append(f"{path / LEDGER}: is missing or damaged from the first line; {to_recover(path)}")
    elif manifest.table is not None and not manifest.chunks_of(TABLE):
        problems.append(f"{path}: the table is not there; import {manifest.table.file} again")
    if is_recorded:
        problems.append(f"{path}: {'; '.join(BEING_RECORDED)}")
    elif manifest.exit_status == "recording":
        problems.append(f"{path}: was never closed: the recording crashed; {to_recover(path)}")
    if sha256(manifest.rig_text.encode()) != manifest.rig_sha256:
        problems.append(f"{path}: the rig file in the manifest does not match the SHA-256")
    return problems


def _companion_problems(path: Path, manifest: Manifest) -> list[str]:
    """Defects of the marks, and of the calibrations next to a run.

    The digests of the calibrations are in the rig file, except in older runs.
    """
    problems = []
    for file in sorted(path.glob(f"*{CALIBRATION}")):
        try:
            digest = sha256(read_bytes(file, MOST_CALIBRATION_BYTES))
        except OSError as error:
            problems.append(str(unreadable(file, error)))
            continue
        except FileError as error:
            problems.append(str(error))
            continue
        if digest not in manifest.rig_text:
            problems.append(f"{file}: does not match the SHA-256 of the calibration in the rig file of the manifest")
    try:
        load_marks(path)
    except FileError as error:
        problems.append(str(error))
    return problems


def _read(path: Path, manifest: Manifest, stream: str) -> _Stream:
    schema, read = manifest.arrow_schema(stream), _Stream(stream)
    for number, chunk in enumerate(manifest.chunks_of(stream), start=1):
        if chunk.number != number and manifest.exit_status != "recovered" and not read.problems:
            read.problems.append(f"{path}: chunk {number} of {stream} is missing, with unknown contents")
        try:
            rows = read_chunk(path, chunk, schema)
        except FileError as error:
            read.problems.append(str(error))
            read.skip_to(read.end if chunk.first_row is None else chunk.first_row)
            read.end += chunk.rows
            continue
        read.rows_read += chunk.rows
        if stream == TABLE:
            read.end += chunk.rows
        else:
            _follow(read, path / chunk.file, rows)
    read.skip_to(max(read.end, manifest.rows.get(stream, 0)))
    return read


def _follow(read: _Stream, file: Path, rows: pa.Table) -> None:
    sequence = rows["sequence"].to_numpy()
    for i in np.flatnonzero(np.diff(sequence, prepend=read.end - 1) != 1):
        expected = read.end if i == 0 else int(sequence[i - 1]) + 1
        read.end = expected
        if sequence[i] < expected:
            read.problems.append(f"{file}: rows before row {i} are duplicated")
        else:
            read.skip_to(int(sequence[i]))
    read.end = int(sequence[-1]) + 1 if len(sequence) else read.end
    if read.name == FAULTS:
        for stream, kind, count in zip(*(rows[name].to_pylist() for name in ("stream", "kind", "count")), strict=True):
            read.faults[stream, kind] += count


def _counters(path: Path, manifest: Manifest, streams: Mapping[str, _Stream]) -> list[str]:
    """Compare the counts of the recording with the content.

    All faults are on the disk only if the run ended normally.
    """
    problems = []
    for stream, counts in manifest.counters.items():
        row_count = streams[stream].rows_read if stream in streams else 0
        if "samples" in counts and stream in streams and counts["samples"] != row_count:
            problems.append(f"{path}: {stream} has {row_count} rows, but {counts['samples']} samples were counted")
    if manifest.exit_status not in ("complete", "interrupted"):
        return problems
    counted = {
        (s, kind): n for s, counts in manifest.counters.items() for kind, n in counts.items() if kind != "samples"
    }
    faults = streams[FAULTS].faults
    for stream, kind in sorted({key for key in counted if counted[key] != faults[key]}):
        n = counted[stream, kind]
        problems.append(f"{path}: {n} {kind} of {stream} were counted, but the faults contain {faults[stream, kind]}")
    return problems
