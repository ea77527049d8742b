"""Figures of runs in an SQLite file, so that a run is evaluated only once.

`rig history` keeps the file next to the runs; `rig fleet`, and both for a remote directory, keep it in the user's
cache, because the directory of a plant may be read-only. A file that is damaged or of a different version is rebuilt
from the runs. SQLite handles concurrent commands and crashes.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import sqlite3
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeVar

from analysis.apps.plant.records import RunRecord
from daq.store.chunk import storable
from rigs.distribution import version
from rigs.errors import CellError, FileError, RigError
from rigs.files import read_from

T = TypeVar("T")
FILE = ".history.sqlite"
"""Hidden, because `runs/*` in a shell should match runs only."""
VERSION = 7
"""Version of the tables and figures."""
_OURS = 0x52494748
_IDS = (b"RIGH", b"RIGF")
"""SQLite's application_id; catalogues up to version 1.1 have `RIGF`. Files of other programs are not touched."""
_MAGIC, _ID_AT, _HEADER = b"SQLite format 3\0", 68, 100
"""Start of an SQLite file, and offset of the application_id in the header (sqlite.org/fileformat.html, 1.3)."""
_WAIT_S = 30.0
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
"""A robot: the directory of its runs relative to the directory of all runs, and the name of its rig file."""


@dataclass(frozen=True)
class Entry:
    """A stored run without its figures."""

    run: str
    """Path relative to the directory of all runs."""
    key: Key
    """Without a name if the manifest is unreadable."""
    signature: str
    """Empty if the run must be examined again."""
    fingerprint: str
    problem: str


class Damaged(FileError):
    """The file is unreadable and must be rebuilt."""

    def __init__(self, path: Path, why: str) -> None:
        remedy = "repeat the command: the file is rebuilt from the runs"
        super().__init__(str(path), f"is damaged ({why})", remedy, code="figures.damaged")


def made_by() -> str:
    """Version of rig and of its figures."""
    return f"{version()}, figures {VERSION}"


def default_path(directory: Path) -> Path:
    """Catalogue in the user's cache, named by a digest of the directory of the runs."""
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    name = hashlib.sha256(os.fsencode(directory.resolve())).hexdigest()[:16]
    return cache / "rig" / f"fleet-{name}.sqlite"


def work_with(path: Path, work: Callable[[Path, tuple[str, ...]], T], *, is_required: bool = False) -> T:
    """Result of `work` with a file of figures and notes about it, once more with a new file if it proves damaged.

    If the file itself cannot be used, `work` gets a temporary copy. is_required: raise the error in this case.
    """
    with ExitStack() as until_done:
        try:
            why = prepare(path)
            notes = (f"{path} {why}: the file was rebuilt from the runs",) if why else ()
            file = path
        except RigError as error:
            if is_required:
                raise
            file = Path(until_done.enter_context(TemporaryDirectory())) / path.name
            if error.code != "figures.foreign":
                with suppress(OSError):
                    shutil.copyfile(path, file)  # figures on a read-only disk save time
            prepare(file)
            notes = (f"{path} cannot be used ({error.what}): new runs are evaluated each time",)
        try:
            return work(file, notes)
        except Damaged:
            _remove(file)
            prepare(file)
            return work(file, (*notes, f"{file} was damaged: the file was rebuilt from the runs"))


def prepare(path: Path) -> str:
    """Create the file if necessary. Returns the reason for rebuilding a previous one, if any.

    Raises CellError if it cannot be written, and FileError for a file that is not of rig.
    """
    problem, remedy = "is not a file of rig with figures", "choose a different --catalogue, or remove the file"
    foreign = FileError(str(path), problem, remedy, code="figures.foreign")
    header = b""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        header = read_from(path, 0, _HEADER)[0]
    except FileNotFoundError:
        pass
    except FileError:  # not a regular file
        raise foreign from None
    except OSError as error:
        raise _refused(path, error) from None
    if header and not (header.startswith(_MAGIC) and header[_ID_AT : _ID_AT + 4] in _IDS):
        raise foreign
    try:
        why = _set_up(path)
    except Damaged:
        why = "was damaged"
    if why:
        _remove(path)
        _set_up(path)
    return why


def _set_up(path: Path) -> str:
    """Create the tables of an empty file. Returns the reason if an existing file is of no use."""
    with _opened(path) as file:
        if file.execute("select count(*) from sqlite_master").fetchone()[0]:
            tables = file.execute("pragma user_version").fetchone()[0]
            is_same = tables == VERSION and file.execute("select * from made_by").fetchall() == [(made_by(),)]
            return "" if is_same else "was made by a different version of rig"
        for statement in _TABLES.split(";\n"):
            file.execute(statement)
        file.execute("insert into made_by values (?)", (made_by(),))
        file.execute(f"pragma application_id = {_OURS}")
        file.execute(f"pragma user_version = {VERSION}")
    return ""


def _remove(path: Path) -> None:
    try:
        for name in (path, path.with_name(path.name + "-journal")):
            name.unlink(missing_ok=True)
    except OSError as error:
        raise _refused(path, error) from None


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
            raise _refused(path, error) from None
        raise Damaged(path, str(error)) from None


def _refused(path: Path, error: Exception) -> CellError:
    problem = f"figures cannot be stored: {getattr(error, 'strerror', None) or error}"
    return CellError(str(path), problem, "choose a different file: --catalogue FILE", code="figures.unwritable")


def entries(path: Path) -> dict[str, Entry]:
    """All runs without their figures, by path."""
    with _opened(path) as file:
        rows = file.execute("select run, folder, robot, signature, fingerprint, problem from runs order by run")
        found = [Entry(os.fsdecode(run), (os.fsdecode(folder), robot), *rest) for run, folder, robot, *rest in rows]
    return {entry.run: entry for entry in found}


def save(path: Path, runs: Iterable[tuple[str, str, RunRecord, str]]) -> None:
    """Store runs: path, signature, record and rig file."""
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
    """Records of a robot, and its rig files by run name."""
    folder, robot = key
    with _opened(path) as file:
        rows = file.execute(
            "select record, rig_text from runs join rigs on rig = sha256 where folder = ? and robot = ? order by run",
            (os.fsencode(folder), robot),
        ).fetchall()
    try:
        records = [RunRecord.of_json(text) for text, _ in rows]
    except (TypeError, ValueError) as error:
        raise Damaged(path, str(error)) from None
    return records, {record.name: rig_text for record, (_, rig_text) in zip(records, rows, strict=True)}


def read_records(path: Path) -> dict[str, RunRecord]:
    """Records of all runs by path, from an existing file that is not changed; empty if it is of no use."""
    if not path.is_file():
        return {}
    try:
        with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True, timeout=_WAIT_S)) as file:
            if file.execute("select * from made_by").fetchall() != [(made_by(),)]:
                return {}
            rows = [(os.fsdecode(run), text) for run, text in file.execute("select run, record from runs")]
        return {run: replace(RunRecord.of_json(text), name=run) for run, text in rows}
    except (sqlite3.Error, TypeError, ValueError):
        return {}


def states(path: Path) -> dict[Key, tuple[str, str]]:
    with _opened(path) as file:
        rows = file.execute("select folder, robot, digest, state from states").fetchall()
    return {(os.fsdecode(folder), robot): (digest, state) for folder, robot, digest, state in rows}


def save_states(path: Path, judged: Sequence[tuple[Key, str, str]], gone: Iterable[Key] = ()) -> None:
    """Store states of robots with digests, and remove deleted robots."""
    with _opened(path) as file:
        rows = [(os.fsencode(folder), robot) for folder, robot in gone]
        file.executemany("delete from states where folder = ? and robot = ?", rows)
        stored = [(os.fsencode(folder), robot, digest, state) for (folder, robot), digest, state in judged]
        file.executemany("insert or replace into states values (?, ?, ?, ?)", stored)
