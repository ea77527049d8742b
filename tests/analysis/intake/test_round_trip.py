import csv
import io
import json
import os
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.intake.read import read_file
from analysis.runs.loading import measured_of
from analysis.runs.written_files import write_csv, write_new, write_parquet
from daq.store import load_manifest, read_run, recover, verify
from daq.store.ledger import sha256
from rigs.errors import FileError
from rigs.load import load
from rigs.schema.vocabulary import Direction, TestName
from rigs.text import escape_lines
from tests.support.table_cases import RIG_FILE, TESTS, Rows, csv_text, plain, rig, rows_of
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
            assert list(column) == [escape_lines(text) for text in rows[name]], name
    back = read_file(out, test, rig())
    manifest, stored, extra = load_manifest(run), read_run(run).table, [name for name in rows if name not in known]
    assert verify(run) == [] and recover(run).nothing_to_do
    assert (manifest.exit_status, manifest.operator, manifest.rig_text) == ("complete", "ada", load(RIG_FILE)[1])
    assert (manifest.counters, manifest.table.sha256) == (
        {"table": {"samples": stored.num_rows}}, sha256(csv_text(rows).encode())
    )  # fmt: skip
    assert back.table.drop_columns(extra).equals(stored.drop_columns(extra))
    assert pq.read_table(exported(run, "parquet")).equals(stored)


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
    assert (manifest.table.file, manifest.operator) == ("k\\udcf6ln.csv", "k\\udcf6ln")
    assert verify(tmp_path / latin) == []


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


@pytest.mark.parametrize("change", [{"table": None}, {"table": {"file": "t", "sha256": "0", "columns": ["q1_deg"]}}])
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
    assert back["extra"].to_pylist() == [escape_lines(text) for text in rows["extra"]]
    assert all(line.isprintable() for line in out.read_text().split("\n"))
