import math
import os
import sqlite3
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest

from analysis.apps.plant import store
from analysis.apps.plant.records import RunRecord
from analysis.procedures.shared.quantity import Quantity
from tests.support.refusals import refused

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


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "deeper" / store.FILE
    assert store.prepare(path) == ()
    save(path, RECORD)
    return path


def test_records_come_back_as_they_were(file):
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
        lambda path: change(path, "drop table made_by"),
        lambda path: change(path, "update made_by set rig = '0.9.0'"),
    ],
)
@pytest.mark.parametrize("application_id", ["0x52494748", "0x52494746"])
def test_damaged_or_earlier_file_is_rebuilt(file, harm, application_id):
    change(file, f"pragma application_id = {application_id}")
    harm(file)
    assert store.read_records(file) == {}
    assert len(store.prepare(file)) == 1 and store.prepare(file) == ()
    save(file, RECORD)
    assert set(store.read_records(file)) == {"lap-1"}


def test_damaged_record_is_refused(file):
    change(file, "update runs set record = '{'")
    assert store.read_records(file) == {}
    with refused("file.invalid", "Expecting property name enclosed in double"):
        store.records_of(file, (".", "ur10e"))


@pytest.mark.parametrize(
    ("make", "code"),
    [
        (lambda path: change(path, "create table theirs (x)"), "file.invalid"),
        (lambda path: path.write_text("a letter"), "file.invalid"),
        (os.mkfifo, "file.invalid"),
        (os.mkdir, "output.not_writable"),
    ],
)
def test_foreign_file_is_left_alone_and_the_next_one_used(tmp_path, make, code):
    path = tmp_path / store.FILE
    make(path)
    before = path.read_bytes() if path.is_file() else b""
    with refused(code):
        store.prepare(path)
    file, notes = store.prepare_first([path, tmp_path / "cache" / "other.sqlite"])
    assert file.parent.name == "cache" and len(notes) == 1
    assert (path.read_bytes() if path.is_file() else b"") == before
    with refused("output.not_writable", "No such file or directory"):
        store.prepare(Path("/proc/rig") / store.FILE)


def test_records_of_parallel_writers_are_all_stored(file):
    names = [f"lap-{number}" for number in range(24)]
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda name: save(file, replace(RECORD, name=name), RECORD), names))
    assert set(store.read_records(file)) == set(names)
