"""The cache file of the history: its content is restored, and damage to it is never fatal."""

from __future__ import annotations

import math
import os
import sqlite3
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest

from analysis.apps.plant.history_file import FILE, Unusable, read_records, write_records
from analysis.apps.plant.records import RunRecord
from analysis.procedures.shared.quantity import Quantity

RECORD = RunRecord(
    "lap-1", "abc", "ur10e", "2026-05-03T09:00:00+00:00", "yaw", "acw", "north", "p1",
    figures={"band_deg": Quantity(0.1, 0.001, "deg", 700, "borrowed"), "rms_deg": Quantity(1.0, math.nan, "deg")},
)  # fmt: skip


def named(number: int) -> RunRecord:
    return replace(RECORD, name=f"lap-{number:03d}")


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / FILE
    write_records(path, [RECORD], [], from_new=False)
    return path


def test_records_come_back_as_they_were(file: Path) -> None:
    odd = RunRecord(os.fsdecode(b"\xff\xfe"), "f", "ur10e", "2026-05-03", "yaw", "cw", "", problem="bad \udcff")
    write_records(file, [odd], [], from_new=False)
    records, why = read_records(file)
    assert not why and set(records) == {"lap-1", odd.name}
    found = records["lap-1"]
    assert replace(found, figures={}) == replace(RECORD, figures={})
    assert found.figures["band_deg"] == RECORD.figures["band_deg"]
    assert math.isnan(found.figures["rms_deg"].u)
    assert records[odd.name].problem == "bad \\udcff"


def test_a_record_replaces_the_older_one_and_gone_runs_go(file: Path) -> None:
    write_records(file, [replace(RECORD, fingerprint="new", figures={})], [], from_new=False)
    assert read_records(file)[0]["lap-1"].figures == {}
    write_records(file, [], ["lap-1"], from_new=False)
    assert read_records(file) == ({}, "")


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:3000])


def overwrite(path: Path) -> None:
    path.write_bytes(b"no database" * 1000)


def forget_tables(path: Path) -> None:
    change(path, "drop table runs")


def spoil_a_date(path: Path) -> None:
    change(path, "update runs set record = replace(record, '2026-05-03', 'yesterday')")


def damage_a_page(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[4096:] = b"\xff" * (len(data) - 4096)
    path.write_bytes(data)


def change(path: Path, statement: str) -> None:
    with closing(sqlite3.connect(path)) as database:
        database.execute(statement)
        database.commit()


@pytest.mark.parametrize("harm", [cut, overwrite, forget_tables, spoil_a_date, damage_a_page])
def test_a_damaged_file_is_made_again(file: Path, harm: object) -> None:
    assert callable(harm)
    harm(file)
    records, why = read_records(file)
    assert records == {} and "damaged" in why
    write_records(file, [RECORD], [], from_new=True)
    assert set(read_records(file)[0]) == {"lap-1"}


@pytest.mark.parametrize("statement", ["pragma user_version = 99", "update made_by set rig = 'older'"])
def test_a_file_of_another_version_is_made_again(file: Path, statement: str) -> None:
    change(file, statement)
    assert read_records(file) == ({}, "was made by a different version of rig")
    write_records(file, [RECORD], [], from_new=True)
    assert set(read_records(file)[0]) == {"lap-1"}


def test_the_database_of_another_program_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / FILE
    change(path, "create table theirs (x)")
    before = path.read_bytes()
    with pytest.raises(Unusable, match="a different program"):
        read_records(path)
    assert path.read_bytes() == before


def test_a_place_where_no_file_can_be_is_unusable(tmp_path: Path) -> None:
    (tmp_path / FILE).mkdir()
    with pytest.raises(Unusable):
        read_records(tmp_path / FILE)
    with pytest.raises(Unusable):
        write_records(tmp_path / FILE, [RECORD], [], from_new=False)
    with pytest.raises(Unusable):
        write_records(tmp_path / "nowhere" / FILE, [RECORD], [], from_new=False)


def test_a_fifo_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / FILE)
    with pytest.raises(Unusable, match="not a regular file"):
        read_records(tmp_path / FILE)


def test_what_several_write_at_once_is_all_there(tmp_path: Path) -> None:
    path = tmp_path / FILE

    def write(number: int) -> None:
        write_records(path, [named(number), named(number % 3)], [], from_new=False)

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(write, range(24)))
    records, why = read_records(path)
    assert not why and set(records) == {named(number).name for number in range(24)}
