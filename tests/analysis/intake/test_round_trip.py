from __future__ import annotations

import csv
import errno
import io
import json
import os
from functools import partial
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.intake.read import read_file
from analysis.runs.loading import measured_of
from analysis.runs.tables import CircleTable, PoseTable, RadialTable, RepeatabilityTable, columns_of
from analysis.runs.written_files import write_csv, write_new, write_parquet
from daq.store import load_manifest, read_run, recover, verify
from daq.store.ledger import sha256
from rigs.errors import FileError
from rigs.load import load
from rigs.schema.vocabulary import Direction, TestName
from rigs.text import plain_lines
from tests.support.command_line import ran
from tests.support.refusals import refused
from tests.support.table_cases import JOINTS, RIG_FILE, TESTS, Rows, csv_text, plain, rig, rows_of, texts
from tests.support.written_runs import import_table

WORDS = {"direction", "approach"}


def imported(folder: Path, rows: Rows, test: TestName, direction: Direction | None = None, name: str = "run") -> Path:
    source = folder / f"{name} table.csv"
    source.write_bytes(csv_text(rows).encode())
    assert import_table(source, folder / name, rig_file=RIG_FILE, test=test, direction=direction, operator="ada") == []
    return folder / name


def exported(run: Path, to: str) -> Path:
    file = run.with_suffix(f".{to}")
    measured = measured_of(read_run(run))
    table, notes = measured.to_table(), list(measured.doubts)
    assert notes == []
    write_new(file, lambda out: (write_csv if to == "csv" else write_parquet)(table, out))
    return file


@pytest.mark.parametrize("direction", ["acw", "cw"])
@pytest.mark.parametrize("test", TESTS)
def test_a_table_goes_in_comes_out_and_comes_back_the_same(tmp_path, test, direction):
    rows = rows_of(test, direction)
    known = set(plain(test))
    run = imported(tmp_path, rows, test)
    out = exported(run, "csv")
    names, *cells = csv.reader(io.StringIO(out.read_bytes().decode(), newline=""))
    assert names == list(rows)
    for name, column in zip(names, zip(*cells, strict=True), strict=True):
        if name in known - WORDS:
            assert [float(text) for text in column] == [float(text) for text in rows[name]], name
        else:
            assert list(column) == [plain_lines(text) for text in rows[name]], name
    back = read_file(out, test, rig())
    stored, extra = read_run(run).table, [name for name in rows if name not in known]
    assert stored is not None and back.table.drop_columns(extra).equals(stored.drop_columns(extra))
    assert pq.read_table(exported(run, "parquet")).equals(stored)


@pytest.mark.parametrize("test", TESTS)
def test_an_imported_run_is_a_run(tmp_path, test):
    rows = rows_of(test, "cw")
    path = imported(tmp_path, rows, test)
    manifest, count = load_manifest(path), len(rows["q1_deg"])
    assert verify(path) == []
    assert recover(path).nothing_to_do
    assert (manifest.test, manifest.operator, manifest.name) == (test, "ada", "run")
    assert manifest.direction == ("cw" if test in ("yaw", "roll") else None)
    assert manifest.rig_text == load(RIG_FILE)[1]
    assert manifest.exit_status == "complete"
    assert manifest.counters == {"table": {"samples": count}}
    assert manifest.table is not None
    assert (manifest.table.file, manifest.table.sha256) == ("run table.csv", sha256(csv_text(rows).encode()))
    assert list(manifest.table.columns) == list(rows)
    run = read_run(path)
    assert (run.streams, run.faults) == ({}, [])
    assert run.table is not None
    assert run.table.num_rows == count
    assert sorted(file.name for file in path.iterdir()) == [
        ".lock",
        "ledger.jsonl",
        "manifest.json",
        "table-0001.parquet",
    ]


def test_tables_in_memory_are_in_rad_and_mm(tmp_path):
    for test in TESTS:
        rows = rows_of(test)
        table = measured_of(read_run(imported(tmp_path, rows, test, name=test))).table
        q_deg = np.array([[float(text) for text in rows[name]] for name in JOINTS]).T
        np.testing.assert_array_equal(table.q, np.radians(q_deg))
        match table:
            case CircleTable():
                assert (table.test, table.direction) == (test, "acw")
                assert texts(table.g_mm[:, 1]) == rows["g2_mm"]
                assert texts(table.t_s) == rows["t_s"]
            case RadialTable():
                assert table.target.tolist() == [int(text) for text in rows["target"]]
                assert table.orientation.tolist() == [int(text) for text in rows["orientation"]]
                assert np.degrees(table.azimuth) == pytest.approx([float(text) for text in rows["azimuth_deg"]])
                assert np.degrees(table.polar) == pytest.approx([float(text) for text in rows["polar_deg"]])
                assert not table.t_s.any()
            case RepeatabilityTable():
                assert table.approach.tolist() == rows["approach"]
                assert table.round.tolist() == [int(text) for text in rows["round"]]
                assert texts(table.t_s) == rows["t_s"]
            case PoseTable():
                assert texts(table.xyz_mm[:, 2]) == rows["z_mm"]
                assert table.rpy is not None
                assert np.degrees(table.rpy[:, 1]) == pytest.approx([float(text) for text in rows["ry_deg"]])


@pytest.mark.parametrize("test", TESTS)
def test_tables_in_memory_become_the_same_columns(tmp_path, test):
    rows = plain(test)
    columns = columns_of(measured_of(read_run(imported(tmp_path, rows, test))).table)
    assert sorted(columns.column_names) == sorted(rows)
    for name in rows:
        if name in WORDS:
            assert columns[name].to_pylist() == rows[name]
        else:
            assert columns[name].to_pylist() == pytest.approx([float(text) for text in rows[name]], rel=1e-15), name


def test_places_alone_make_a_pose_table(tmp_path):
    rows = {name: cells for name, cells in plain("pose").items() if not name.startswith("r")}
    table = measured_of(read_run(imported(tmp_path, rows, "pose"))).table
    assert isinstance(table, PoseTable)
    assert table.rpy is None
    assert columns_of(table).column_names == list(rows)


def test_a_circle_without_direction_takes_that_of_the_command(tmp_path):
    rows = rows_of("yaw", "cw")
    del rows["direction"]
    run = imported(tmp_path, rows, "yaw", "cw")
    assert load_manifest(run).direction == "cw"
    back = read_file(exported(run, "csv"), "yaw", rig())
    assert back.direction == "cw"
    assert [name for name in back.table.column_names if name != "direction"] == list(rows)


def test_spreadsheet_formats_are_read(tmp_path):
    rows = plain("repeatability")
    text = "\n".join(",".join(cells) for cells in [tuple(rows), *zip(*rows.values(), strict=True)])
    table = tmp_path / "table.csv"
    table.write_text(text + "\n")
    plainly = read_file(table, "repeatability", rig()).table
    table.write_bytes(b"\xef\xbb\xbf" + (text.replace("\n", "\r\n") + "\r\n\r\n").encode())
    assert read_file(table, "repeatability", rig()).table.equals(plainly)
    table.write_text(text.replace(",1,", ", 1.0 ,"))
    assert read_file(table, "repeatability", rig()).table.equals(plainly)


def test_names_without_utf8_are_kept_as_far_as_possible(tmp_path):
    latin = os.fsdecode(b"k\xf6ln")
    source = tmp_path / f"{latin}.csv"
    source.write_text(csv_text(plain("pose")))
    import_table(source, tmp_path / latin, rig_file=RIG_FILE, test="pose", direction=None, operator=latin)
    manifest = read_run(tmp_path / latin).manifest
    assert manifest.table is not None
    assert (manifest.table.file, manifest.operator) == ("k\\udcf6ln.csv", "k\\udcf6ln")
    assert verify(tmp_path / latin) == []


def test_nothing_is_overwritten(tmp_path):
    run = imported(tmp_path, plain("pose"), "pose")
    before = {file: file.read_bytes() for file in run.iterdir()}
    with pytest.raises(FileError, match="exists already"):
        imported(tmp_path, plain("pose"), "pose")
    (tmp_path / "empty").mkdir()
    with pytest.raises(FileError, match="exists already"):
        imported(tmp_path, plain("pose"), "pose", name="empty")
    file = exported(run, "csv")
    data = file.read_bytes()
    with pytest.raises(FileError, match="exists already"):
        exported(run, "csv")
    assert file.read_bytes() == data
    assert {file: file.read_bytes() for file in run.iterdir()} == before


def test_a_refused_file_leaves_nothing(tmp_path, monkeypatch):
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "full")

    with refused("disk.full"):
        write_new(tmp_path / "file", full)
    monkeypatch.setattr("daq.store.imported.durable.replace", full)
    with refused("run.not_writable"):
        imported(tmp_path, plain("pose"), "pose")
    assert [file.name for file in tmp_path.iterdir()] == ["run table.csv"]


def test_an_import_cut_off_is_seen_and_recovered(tmp_path, monkeypatch):
    rows = rows_of("pose")
    run = imported(tmp_path, rows, "pose")
    whole = read_run(run).table
    (run / "manifest.json").unlink()
    (run / "ledger.jsonl").unlink()
    assert recover(run).rows == {"table": len(rows["q1_deg"])}
    assert verify(run) == []
    assert read_run(run).table == whole
    assert load_manifest(run).exit_status == "recovered"
    (run / "table-0001.parquet").unlink()
    assert "missing" in verify(run)[0]


def test_a_damaged_table_is_not_read(tmp_path):
    run = imported(tmp_path, plain("pose"), "pose")
    file = run / "table-0001.parquet"
    data = bytearray(file.read_bytes())
    data[len(data) // 2] ^= 1
    file.write_bytes(data)
    assert "has changed" in verify(run)[0]
    with refused("run.changed"):
        read_run(run)


@pytest.mark.parametrize(
    "change",
    [
        {"table": None},
        {"table": {"file": "t", "sha256": "0", "columns": {"q1_deg": "double"}}},
        {"table": {"file": "t", "sha256": "0", "columns": {"q1_deg": "int32"}}},
        {"table": {"file": "t", "sha256": "0", "columns": ["q1_deg"]}},
        {"streams": {"g1": ["g1_mm"]}},
        {"test": "radial"},
    ],
)
def test_a_manifest_that_does_not_match_its_table(tmp_path, change):
    run = imported(tmp_path, plain("pose"), "pose")
    manifest = run / "manifest.json"
    manifest.write_text(json.dumps(json.loads(manifest.read_text()) | change))
    with pytest.raises(FileError):
        measured_of(read_run(run))


@given(st.lists(st.text(st.characters(exclude_characters="\0", codec="utf-8")), min_size=1, max_size=8))
def test_extra_columns_hold_any_text(tmp_path_factory, texts):
    rows = plain("pose")
    rows = {"extra": [texts[k % len(texts)] for k in range(len(rows["q1_deg"]))], **rows}
    file = tmp_path_factory.mktemp("any") / "in.csv"
    file.write_bytes(csv_text(rows).encode())
    table = read_file(file, "pose", rig()).table
    assert table["extra"].to_pylist() == rows["extra"]
    out = file.with_name("out.csv")
    write_new(out, lambda sink: write_csv(table, sink))
    back = read_file(out, "pose", rig()).table
    assert back.drop_columns("extra").equals(table.drop_columns("extra"))
    assert back["extra"].to_pylist() == [plain_lines(text) for text in rows["extra"]]
    assert all(line.isprintable() for line in out.read_text(encoding="utf-8").split("\n"))


def test_the_commands(tmp_path):
    (tmp_path / "t.csv").write_text(csv_text(plain("roll", "cw")))
    run = partial(ran, cwd=tmp_path)
    made = run("import", "t.csv", "--rig", RIG_FILE, "--test", "roll", "-o", "runs/roll-cw")
    assert (made.returncode, made.stdout, made.stderr) == (0, "runs/roll-cw\n", "")
    made = run("export", "runs/roll-cw", "--to", "csv", "-o", "back.csv")
    assert (made.returncode, made.stdout, made.stderr) == (0, "back.csv\n", "")
    assert len((tmp_path / "back.csv").read_text().splitlines()) == len((tmp_path / "t.csv").read_text().splitlines())
    (tmp_path / "t.csv").write_text((tmp_path / "t.csv").read_text().replace('"cw"', '"ccw"', 2))
    refused = run("import", "t.csv", "--rig", RIG_FILE, "--test", "roll", "-o", "runs/other")
    assert (refused.returncode, refused.stdout) == (3, "")
    (line,) = refused.stderr.splitlines()
    assert line.startswith("error: t.csv, line 2, direction: 'ccw' ") and "acw?" in line
