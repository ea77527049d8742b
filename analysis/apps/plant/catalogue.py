"""Catalogue of a plant: an SQLite file with the figures of each run, so that runs are read only once.

It contains derived data only, and is stored outside the plant's directory, which remains unchanged and may be
read-only. A damaged catalogue, or a catalogue of a different version, is rebuilt. The locks and the journal of SQLite
handle concurrent commands and crashes.
"""

from __future__ import annotations

import hashlib
import os
import sqlite3
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

from analysis.apps.plant import history_file
from analysis.apps.plant.records import RunRecord
from analysis.apps.plant.seen import Examined, RunOnDisk
from daq.store.chunk import storable
from rigs.errors import CellError, FileError

VERSION = 1
"""Version of the tables. The figures have the versions of the history and of rig."""
_OURS = 0x52494746
"""SQLite's application_id, `RIGF`."""
_MAGIC, _ID_AT, _HEADER = b"SQLite format 3\0", 68, 100
"""Start of an SQLite file, and offset of the application_id in the header (sqlite.org/fileformat.html, 1.3)."""
_WAIT_S = 30.0
# Tables with records have rowids. In tables declared `without rowid`, SQLite stores rows above a quarter of a page in
# separate pages, which doubles the size of the file.
_TABLES = """
create table made_by (rig text not null);
create table rigs (sha256 text primary key, rig_text text not null) without rowid;
create table runs (
    run blob unique not null, folder blob not null, robot text not null, signature text not null,
    fingerprint text not null, rig text not null, problem text not null, record text not null);
create index runs_of_robots on runs (folder, robot);
create table states (
    folder blob not null, robot text not null, digest text not null, state text not null,
    primary key (folder, robot)) without rowid;
"""

Key = tuple[str, str]
"""A robot: the directory of its runs relative to the plant's directory, and its name."""


@dataclass(frozen=True)
class CatalogueEntry:
    """The catalogue entry of a run in addition to its figures.

    run: path relative to the plant's directory. signature: empty if a new examination is needed. robot: empty if the
    manifest is unreadable.
    """

    run: str
    key: Key
    signature: str
    fingerprint: str
    problem: str


class Damaged(FileError):
    """The catalogue is unreadable and must be rebuilt."""

    def __init__(self, path: Path, why: str) -> None:
        super().__init__(str(path), f"is damaged ({why})", "repeat the command: the catalogue is rebuilt from the runs")


def default_path(directory: Path) -> Path:
    """Return the default path of a plant's catalogue: in the user's cache, named by a digest of the plant's path."""
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    name = hashlib.sha256(os.fsencode(directory.resolve())).hexdigest()[:16]
    return cache / "rig" / f"fleet-{name}.sqlite"


def refuse_foreign(path: Path) -> None:
    """Raise FileError for an existing file that is not a catalogue."""
    try:
        if not path.exists():
            return
        if not path.is_file():  # Opening a FIFO would block.
            raise FileError(str(path), "is not a regular file", "choose a different --catalogue")
        with path.open("rb") as file:
            header = file.read(_HEADER)
    except OSError as error:
        raise FileError(str(path), error.strerror or str(error), "choose a different --catalogue") from None
    is_ours = header.startswith(_MAGIC) and header[_ID_AT : _ID_AT + 4] == _OURS.to_bytes(4)
    if header and not is_ours:
        raise FileError(
            str(path), "is not a catalogue of rig fleet", "choose a different --catalogue, or remove the file"
        )


def require_writable(path: Path) -> None:
    """Raise CellError if a catalogue cannot be stored at a path."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=path.parent).close()
        if path.exists():
            path.open("ab").close()
    except OSError as error:
        raise _refused(path, error) from None


def prepare(path: Path) -> str:
    """Create a writable catalogue, and return the reason for rebuilding a previous one, if any.

    Raises CellError if it cannot be created.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _refused(path, error) from None
    try:
        why = _set_up(path)
    except Damaged:
        why = "was damaged"
    if why:
        remove(path)
        _set_up(path)
    return why


def remove(path: Path) -> None:
    """Delete a catalogue. Raises CellError."""
    try:
        for name in (path, path.with_name(path.name + "-journal")):
            name.unlink(missing_ok=True)
    except OSError as error:
        raise _refused(path, error) from None


def _set_up(path: Path) -> str:
    """Create the tables of an empty file. Return the reason if an existing file is unusable."""
    made_by = f"{history_file.made_by()}, figures {history_file.VERSION}"
    with _changing(path) as file:
        if file.execute("select count(*) from sqlite_master").fetchone()[0]:
            ids = [file.execute(f"pragma {pragma}").fetchone()[0] for pragma in ("application_id", "user_version")]
            is_same = ids == [_OURS, VERSION] and file.execute("select * from made_by").fetchall() == [(made_by,)]
            return "" if is_same else "was made by a different version of rig"
        for statement in _TABLES.split(";\n"):
            file.execute(statement)
        file.execute("insert into made_by values (?)", (made_by,))
        file.execute(f"pragma application_id = {_OURS}")
        file.execute(f"pragma user_version = {VERSION}")
    return ""


@contextmanager
def _opened(path: Path) -> Iterator[sqlite3.Connection]:
    try:
        with closing(sqlite3.connect(path, timeout=_WAIT_S, isolation_level=None)) as file:
            yield file
    except sqlite3.Error as error:
        if history_file.is_of_the_system(error):
            raise _refused(path, error) from None
        raise Damaged(path, str(error)) from None


@contextmanager
def _changing(path: Path) -> Iterator[sqlite3.Connection]:
    """Provide the database in a transaction."""
    with _opened(path) as file:
        file.execute("begin immediate")
        yield file
        file.execute("commit")


def _refused(path: Path, error: Exception) -> CellError:
    problem = getattr(error, "strerror", None) or str(error)
    return CellError(
        str(path), f"the catalogue cannot be written: {problem}", "choose a different file: --catalogue FILE"
    )


def entries(path: Path) -> dict[str, CatalogueEntry]:
    """Return all entries by run. Raises CellError."""
    with _opened(path) as file:
        rows = file.execute("select run, folder, robot, signature, fingerprint, problem from runs order by run")
        entries_found = (
            CatalogueEntry(os.fsdecode(run), (os.fsdecode(folder), robot), *columns)
            for run, folder, robot, *columns in rows
        )
        return {entry.run: entry for entry in entries_found}


def keep(path: Path, examined_runs: Iterable[tuple[RunOnDisk, Examined | None]]) -> None:
    """Store examined runs; None stands for a deleted run. Raises CellError."""
    with _changing(path) as file:
        for seen, examined in examined_runs:
            if examined is None:
                file.execute("delete from runs where run = ?", (os.fsencode(seen.run),))
            else:
                record = examined.record
                sha256 = hashlib.sha256(examined.rig_text.encode("utf-8", "surrogatepass")).hexdigest()
                file.execute("insert or ignore into rigs values (?, ?)", (sha256, storable(examined.rig_text)))
                signature = seen.signature if examined.is_evaluated else ""
                label = (record.rig, signature, record.fingerprint, sha256)
                file.execute(
                    "insert or replace into runs values (?, ?, ?, ?, ?, ?, ?, ?)",
                    (
                        os.fsencode(seen.run),
                        os.fsencode(Path(seen.run).parent),
                        *label,
                        storable(record.problem),
                        record.as_json,
                    ),
                )


def remove_runs(path: Path, runs: Iterable[str]) -> None:
    """Remove deleted runs. Raises CellError."""
    with _changing(path) as file:
        file.executemany("delete from runs where run = ?", [(os.fsencode(run),) for run in runs])


def records_of(path: Path, key: Key) -> tuple[list[RunRecord], dict[str, str]]:
    """Return the records of a robot's runs, and the rig files by run name. Raises CellError."""
    folder, robot = key
    with _opened(path) as file:
        rows = file.execute(
            "select record, rig from runs where folder = ? and robot = ? order by run", (os.fsencode(folder), robot)
        ).fetchall()
        texts = dict(
            file.execute(
                "select distinct sha256, rig_text from rigs join runs on rig = sha256 where folder = ? and robot = ?",
                (os.fsencode(folder), robot),
            )
        )
    try:
        records = [RunRecord.of_json(text) for text, _ in rows]
    except (TypeError, ValueError) as error:
        raise Damaged(path, str(error)) from None
    return records, {record.name: texts.get(rig, "") for record, (_, rig) in zip(records, rows, strict=True)}


def states(path: Path) -> dict[Key, tuple[str, str]]:
    """Return the stored digest and state of each robot. Raises CellError."""
    with _opened(path) as file:
        rows = file.execute("select folder, robot, digest, state from states").fetchall()
    return {(os.fsdecode(folder), robot): (digest, state) for folder, robot, digest, state in rows}


def keep_states(path: Path, judged: Iterable[tuple[Key, str, str]]) -> None:
    """Store robot states with digests. Raises CellError."""
    with _changing(path) as file:
        rows = [(os.fsencode(folder), robot, digest, state) for (folder, robot), digest, state in judged]
        file.executemany("insert or replace into states values (?, ?, ?, ?)", rows)


def forget_states(path: Path, keys: Iterable[Key]) -> None:
    """Remove deleted robots. Raises CellError."""
    with _changing(path) as file:
        rows = [(os.fsencode(folder), robot) for folder, robot in keys]
        file.executemany("delete from states where folder = ? and robot = ?", rows)
