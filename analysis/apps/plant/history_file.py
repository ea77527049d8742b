"""`.history.sqlite` next to the runs: cached figures, so that a run is evaluated only once.

It contains derived data only: if it is deleted, damaged or of a different version, it is rebuilt with the same content.
The locks and the journal of SQLite handle concurrent writers and crashes.
"""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Iterable
from contextlib import closing
from datetime import datetime
from pathlib import Path

from analysis.apps.plant.records import RunRecord
from rigs.distribution import version

FILE = ".history.sqlite"
"""A hidden file, because `runs/*` in a shell should match runs only."""
VERSION = 6
"""Version of the tables and figures."""
_OURS = 0x52494748
"""SQLite's application_id, `RIGH`: databases of other programs are not touched."""
_MOST_BYTES = 1_000_000_000
"""About 300 000 runs of 40 figures; a larger file does not belong to rig."""
_WAIT_S = 10.0
_OF_THE_SYSTEM = {
    sqlite3.SQLITE_PERM,
    sqlite3.SQLITE_BUSY,
    sqlite3.SQLITE_LOCKED,
    sqlite3.SQLITE_READONLY,
    sqlite3.SQLITE_IOERR,
    sqlite3.SQLITE_FULL,
    sqlite3.SQLITE_CANTOPEN,
}
"""Errors of disk, permissions and locks: the file may be valid and is not deleted."""
_TABLES = """
create table made_by (rig text not null);
create table runs (name blob primary key, record text not null) without rowid;
"""


class Unusable(Exception):
    """The file can neither be read nor created: the history then exists in memory only."""


def read_records(path: Path) -> tuple[dict[str, RunRecord], str]:
    """Return the records by name, and the reason for rebuilding the file, if any. Raises Unusable."""
    if not path.exists():
        return {}, ""
    if not path.is_file():  # Opening a FIFO would block.
        raise Unusable("it is not a regular file")
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise sqlite3.DatabaseError("is too large")
        with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True, timeout=_WAIT_S)) as file:
            _check_owner(file)
            if _version(file) != VERSION or file.execute("select rig from made_by").fetchall() != [(made_by(),)]:
                return {}, "was made by a different version of rig"
            records = {}
            for (text,) in file.execute("select record from runs order by name"):
                record = RunRecord.of_json(text)
                if not record.problem:
                    datetime.fromisoformat(record.started)  # A ValueError means damage.
                records[record.name] = record
            return records, ""
    except (sqlite3.Error, TypeError, ValueError) as error:
        if is_of_the_system(error):
            raise Unusable(str(error)) from None
        return {}, f"was damaged ({error})"


def is_of_the_system(error: Exception) -> bool:
    """Return whether the error is due to disk, permissions or locks, so that the file may be valid."""
    return getattr(error, "sqlite_errorcode", 0) & 0xFF in _OF_THE_SYSTEM


def write_records(path: Path, records: Iterable[RunRecord], gone: Iterable[str], *, from_new: bool) -> None:
    """Add records, and remove the records of deleted runs. from_new: rebuild the file. Raises Unusable."""
    try:
        if from_new:
            for name in (path, path.with_name(path.name + "-journal")):
                name.unlink(missing_ok=True)
        with closing(sqlite3.connect(path, timeout=_WAIT_S, isolation_level=None)) as file:
            file.execute("begin immediate")
            _check_owner(file)
            if _version(file) != VERSION:
                for statement in _TABLES.split(";\n"):
                    file.execute(statement)
                file.execute("insert into made_by values (?)", (made_by(),))
                file.execute(f"pragma application_id = {_OURS}")
                file.execute(f"pragma user_version = {VERSION}")
            file.executemany("delete from runs where name = ?", [(os.fsencode(name),) for name in gone])
            rows = [(os.fsencode(record.name), record.as_json) for record in records]
            file.executemany("insert or replace into runs values (?, ?)", rows)
            file.execute("commit")
    except (sqlite3.Error, OSError) as error:
        raise Unusable(str(error)) from None


def _check_owner(file: sqlite3.Connection) -> None:
    """Raise Unusable for a database of a different program."""
    tables = file.execute("select count(*) from sqlite_master").fetchone()[0]
    if tables and file.execute("pragma application_id").fetchone()[0] != _OURS:
        raise Unusable("it is the database of a different program")


def _version(file: sqlite3.Connection) -> int:
    return int(file.execute("pragma user_version").fetchone()[0])


def made_by() -> str:
    """Return the version of rig, because figures may differ between versions."""
    return version()
