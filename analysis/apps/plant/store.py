"""Figures of runs in an SQLite file, so that a run is evaluated only once.

`rig history` keeps it next to the runs, `rig fleet` in the user's cache. A file that is damaged or of another version
is rebuilt from the runs.
"""

from __future__ import annotations

import hashlib
import os
import sqlite3
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from analysis.apps.plant.records import RunRecord
from daq.store.chunk import storable
from rigs.distribution import version
from rigs.errors import CellError, FileError, RigError
from rigs.files import read_from

FILE = ".history.sqlite"
"""Hidden, because `runs/*` in a shell should match runs only."""
VERSION = 7
"""Version of the tables and figures."""
_OURS = 0x52494748
_IDS = (b"RIGH", b"RIGF")
"""Catalogues up to version 1.1 have `RIGF`. Files of other programs are not touched."""
_MAGIC, _ID_AT, _HEADER = b"SQLite format 3\0", 68, 100
"""Start of an SQLite file, and place of the application_id (sqlite.org/fileformat.html, 1.3)."""
_WAIT_S = 30.0
_OF_THE_SYSTEM = {
    sqlite3.SQLITE_PERM, sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED, sqlite3.SQLITE_READONLY, sqlite3.SQLITE_IOERR,
    sqlite3.SQLITE_FULL, sqlite3.SQLITE_CANTOPEN,
}  # fmt: skip
"""Errors of disk, permissions and locks: the file may be valid and is not deleted."""
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
"""Directory of the runs relative to that of all runs, and name of the rig file."""


@dataclass(frozen=True)
class Entry:
    run: str
    key: Key
    signature: str
    """Empty if the run must be examined again."""
    fingerprint: str
    problem: str


def made_by() -> str:
    return f"{version()}, figures {VERSION}"


def default_path(directory: Path) -> Path:
    """Catalogue in the user's cache, named by a digest of the directory of the runs."""
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    name = hashlib.sha256(os.fsencode(directory.resolve())).hexdigest()[:16]
    return cache / "rig" / f"fleet-{name}.sqlite"


def prepare_first(paths: Sequence[Path]) -> tuple[Path, tuple[str, ...]]:
    """The first file that can be used, and notes. Raises the error of the last."""
    *preferred, last = paths
    notes: tuple[str, ...] = ()
    for path in preferred:
        try:
            return path, notes + prepare(path)
        except RigError as error:
            notes += (f"{path} cannot be used ({error.what}): the figures are stored in {last}",)
    return last, notes + prepare(last)


def prepare(path: Path) -> tuple[str, ...]:
    """Create the file if necessary; a note if a previous file is replaced.

    Raises CellError if it cannot be written, and FileError for a file that is not of rig.
    """
    remedy = "choose a different file, or remove it"
    foreign = FileError(str(path), "is not a file of rig with figures", remedy, code="file.invalid")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        header = read_from(path, 0, _HEADER)[0] if path.exists() else b""
    except FileError:  # not a regular file
        raise foreign from None
    except OSError as error:
        raise _unwritable(path, error) from None
    if header and not (header.startswith(_MAGIC) and header[_ID_AT : _ID_AT + 4] in _IDS):
        raise foreign
    try:
        with _opened(path) as file:
            if not file.execute("select count(*) from sqlite_master").fetchone()[0]:
                for statement in (*_TABLES.split(";\n"), f"pragma application_id = {_OURS}"):
                    file.execute(statement)
                file.execute("insert into made_by values (?)", (made_by(),))
                return ()
            if file.execute("pragma quick_check(1)").fetchone() != ("ok",):
                why = "was damaged"
            elif _is_current(file):
                return ()
            else:
                why = "was made by a different version of rig"
    except FileError:
        why = "was damaged"
    try:
        for name in (path, path.with_name(path.name + "-journal")):
            name.unlink(missing_ok=True)
    except OSError as error:
        raise _unwritable(path, error) from None
    prepare(path)
    return (f"{path} {why}: the file was rebuilt from the runs",)


def _is_current(file: sqlite3.Connection) -> bool:
    return file.execute("select * from made_by").fetchall() == [(made_by(),)]


@contextmanager
def _opened(path: Path) -> Iterator[sqlite3.Connection]:
    """The database in a transaction."""
    try:
        with closing(sqlite3.connect(path, timeout=_WAIT_S, isolation_level=None)) as file:
            file.execute("begin immediate")
            yield file
            file.execute("commit")
    except sqlite3.Error as error:
        if getattr(error, "sqlite_errorcode", 0) & 0xFF in _OF_THE_SYSTEM:
            raise _unwritable(path, error) from None
        raise _damaged(path, error) from None


def _damaged(path: Path, error: Exception) -> FileError:
    return FileError(str(path), f"is damaged ({error})", "remove it: it is rebuilt from the runs", code="file.invalid")


def _unwritable(path: Path, error: Exception) -> CellError:
    problem = f"figures cannot be stored: {getattr(error, 'strerror', None) or error}"
    remedy = "choose a different file (--catalogue FILE), or give XDG_CACHE_HOME a writable directory"
    return CellError(str(path), problem, remedy, code="output.not_writable")


def entries(path: Path) -> dict[str, Entry]:
    with _opened(path) as file:
        rows = file.execute("select run, folder, robot, signature, fingerprint, problem from runs order by run")
        found = [Entry(os.fsdecode(run), (os.fsdecode(folder), robot), *rest) for run, folder, robot, *rest in rows]
    return {entry.run: entry for entry in found}


def save(path: Path, runs: Iterable[tuple[str, str, RunRecord, str]]) -> None:
    with _opened(path) as file:
        for run, signature, record, rig_text in runs:
            sha256 = hashlib.sha256(rig_text.encode("utf-8", "surrogatepass")).hexdigest()
            file.execute("insert or ignore into rigs values (?, ?)", (sha256, storable(rig_text)))
            label = (os.fsencode(run), os.fsencode(Path(run).parent), record.rig, signature, record.fingerprint, sha256)
            row = (*label, storable(record.problem), record.as_json)
            file.execute("insert or replace into runs values (?, ?, ?, ?, ?, ?, ?, ?)", row)


def forget(path: Path, runs: Iterable[str]) -> None:
    with _opened(path) as file:
        file.executemany("delete from runs where run = ?", [(os.fsencode(run),) for run in runs])


def records_of(path: Path, key: Key) -> tuple[list[RunRecord], dict[str, str]]:
    folder, robot = key
    with _opened(path) as file:
        rows = file.execute(
            "select record, rig_text from runs join rigs on rig = sha256 where folder = ? and robot = ? order by run",
            (os.fsencode(folder), robot),
        ).fetchall()
    try:
        records = [RunRecord.of_json(text) for text, _ in rows]
    except (TypeError, ValueError) as error:
        raise _damaged(path, error) from None
    return records, {record.name: rig_text for record, (_, rig_text) in zip(records, rows, strict=True)}


def read_records(path: Path) -> dict[str, RunRecord]:
    if not path.is_file():
        return {}
    try:
        with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True, timeout=_WAIT_S)) as file:
            rows = file.execute("select run, record from runs").fetchall() if _is_current(file) else []
        return {run: replace(RunRecord.of_json(text), name=run) for run, text in ((os.fsdecode(r), t) for r, t in rows)}
    except (sqlite3.Error, TypeError, ValueError):
        return {}


def states(path: Path) -> dict[Key, tuple[str, str]]:
    with _opened(path) as file:
        rows = file.execute("select folder, robot, digest, state from states").fetchall()
    return {(os.fsdecode(folder), robot): (digest, state) for folder, robot, digest, state in rows}


def save_states(path: Path, judged: Sequence[tuple[Key, str, str]], gone: Iterable[Key] = ()) -> None:
    with _opened(path) as file:
        rows = [(os.fsencode(folder), robot) for folder, robot in gone]
        file.executemany("delete from states where folder = ? and robot = ?", rows)
        stored = [(os.fsencode(folder), robot, digest, state) for (folder, robot), digest, state in judged]
        file.executemany("insert or replace into states values (?, ?, ?, ?)", stored)
