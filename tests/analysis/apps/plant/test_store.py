from __future__ import annotations

import math
import os
import sqlite3
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest

from analysis.apps.plant import store
from analysis.apps.plant.records import RunRecord
from analysis.procedures.shared.quantity import Quantity
from rigs.errors import RigError

RECORD = RunRecord(
    "lap-1", "abc", "ur10e", "2026-05-03T09:00:00+00:00", "yaw", "acw", "north", "p1",
    figures={"band_deg": Quantity(0.1, 0.001, "deg", 700, "borrowed"), "rms_deg": Quantity(1.0, math.nan, "deg")},
)  # fmt: skip


def save(path: Path, *records: RunRecord) -> None:
    store.save(path, [(record.name, "signature", record, "name: cell") for record in records])


def change(path: Path, statement: str) -> None:
    with closing(sqlite3.connect(path)) as database:
        database.execute(statement)
        database.commit()


def used(path: Path, notes: tuple[str, ...]) -> tuple[Path, tuple[str, ...], set[str]]:
    """The file that work gets, the notes about it, and the stored runs."""
    return path, notes, set(store.entries(path))


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "deeper" / store.FILE
    assert store.prepare(path) == ""
    save(path, RECORD)
    return path


def test_records_come_back_as_they_were(file: Path) -> None:
    odd = RunRecord(os.fsdecode(b"\xff\xfe"), "f", "ur10e", "2026-05-03", "yaw", "cw", "", problem="bad \udcff")
    save(file, odd, replace(RECORD, name="lap-1", fingerprint="new"))
    records = store.read_records(file)
    assert set(records) == {"lap-1", odd.name} == set(store.entries(file))
    found = records["lap-1"]
    assert replace(found, figures={}) == replace(RECORD, figures={}, fingerprint="new")
    assert found.figures["band_deg"] == RECORD.figures["band_deg"] and math.isnan(found.figures["rms_deg"].u)
    assert records[odd.name].problem == "bad \\udcff"
    assert store.records_of(file, (".", "ur10e"))[1] == dict.fromkeys(records, "name: cell")
    store.forget(file, ["lap-1"])
    assert set(store.read_records(file)) == {odd.name}


def damage_a_page(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[4096:] = b"\xff" * (len(data) - 4096)
    path.write_bytes(data)


@pytest.mark.parametrize(
    "harm",
    [
        lambda path: path.write_bytes(path.read_bytes()[:3000]),
        damage_a_page,
        lambda path: change(path, "update runs set record = '{'"),
        lambda path: change(path, "drop table runs"),
    ],
)
def test_a_damaged_file_is_rebuilt(file: Path, harm: Callable[[Path], object]) -> None:
    harm(file)
    assert store.read_records(file) == {}

    def work(used: Path, about: tuple[str, ...]) -> tuple[str, ...]:
        for key in {entry.key for entry in store.entries(used).values()}:
            store.records_of(used, key)
        return about

    assert len(store.work_with(file, work, is_required=True)) == 1
    save(file, RECORD)
    assert set(store.read_records(file)) == {"lap-1"}


@pytest.mark.parametrize("statement", ["pragma user_version = 6", "pragma application_id = 0x52494746", "select 1"])
def test_a_file_of_an_earlier_version_is_rebuilt(file: Path, statement: str) -> None:
    change(file, "update made_by set rig = '0.9.0'")
    change(file, statement)
    assert store.read_records(file) == {}
    path, notes, entries = store.work_with(file, used)
    assert path == file and len(notes) == 1 and entries == set()


@pytest.mark.parametrize(
    ("make", "code"),
    [
        (lambda path: change(path, "create table theirs (x)"), "figures.foreign"),
        (lambda path: path.write_text("a letter"), "figures.foreign"),
        (os.mkfifo, "figures.foreign"),
        (os.mkdir, "figures.unwritable"),
    ],
)
def test_a_foreign_file_is_left_alone_and_a_temporary_one_used(
    tmp_path: Path, make: Callable[[Path], object], code: str
) -> None:
    path = tmp_path / store.FILE
    make(path)
    before = path.read_bytes() if path.is_file() else b""
    with pytest.raises(RigError) as refused:
        store.work_with(path, used, is_required=True)
    assert refused.value.code == code
    file, notes, entries = store.work_with(path, used)
    assert file != path and len(notes) == 1 and entries == set()
    assert not file.exists() and (path.read_bytes() if path.is_file() else b"") == before


def test_figures_on_a_disk_that_cannot_be_written_are_read(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    set_up = store._set_up

    def refuse(path: Path) -> str:
        if path == file:
            raise store._refused(path, OSError("read-only"))
        return set_up(path)

    monkeypatch.setattr(store, "_set_up", refuse)
    path, notes, entries = store.work_with(file, used)
    assert path != file and len(notes) == 1 and entries == {"lap-1"}
    _, notes, entries = store.work_with(Path("/proc/rig") / store.FILE, used)
    assert len(notes) == 1 and entries == set()


def test_records_of_parallel_writers_are_all_stored(file: Path) -> None:
    names = [f"lap-{number}" for number in range(24)]
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda name: save(file, replace(RECORD, name=name), RECORD), names))
    assert set(store.read_records(file)) == set(names)
