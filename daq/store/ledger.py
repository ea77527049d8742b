"""The ledger of a run, `ledger.jsonl`: what was recorded, one line for each record, only ever appended to.

Each line holds the SHA-256 over the one of the line before it and its own content, so that no line can change or go
missing unseen. Whatever follows the last line that verifies is left out: a crash leaves a line half-written. See
docs/decisions/0017-a-run-proves-that-it-is-whole.md.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from daq.store import durable
from daq.store.records import Chunk, Clock, Record, Relabelling, Seal, sha256, to_recover
from rigs.errors import FileError
from rigs.files import read_bytes

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
        entry = _entry(line, last)
        if entry is None:
            break
        entries.append(entry)
        size, last = size + len(line) + 1, line[len(b'{"sha256":"') :][:64].decode()
        seal = last if entry.seal else seal
    return Verified(tuple(entries), size, last, len(data) - size, data.count(b"\n", size), seal)


def _entry(line: bytes, before: str) -> Entry | None:
    match = _LINE.fullmatch(line)
    if match is None or match["digest"].decode() != sha256(before.encode() + b"{" + match["rest"] + b"}"):
        return None
    return _content(match)


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
