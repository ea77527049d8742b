import csv
import io
import math
import time
import zipfile
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path

import numpy as np
import openpyxl
import pyarrow as pa
import pytest

from analysis.apps.interchange import bag_reader
from analysis.apps.interchange.bags import MCAP_MAGIC, SQLITE_MAGIC
from analysis.apps.interchange.urdf import import_urdf
from analysis.intake import raw_table, readers
from analysis.intake.raw_table import sheets_of
from analysis.intake.read import parse_csv
from analysis.runs.written_files import as_it_was, no_formula, write_csv, write_xlsx
from rigs.errors import FileError
from rigs.load import load
from tests.support.refusals import refused

RIG = load("ur10e-cell")[0]
HEADER = "t_s,direction,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,g1_mm,g2_mm"


@pytest.mark.parametrize(
    ("data", "told"),
    [
        (b"#ROSBAG V2.0\n\xff\x00\x01", "ROS 1; .* MCAP"),
        (b"\x28\xb5\x2f\xfd\x00\xff", r"zstd -d lap"),
        (b"\x1f\x8b\x08\x00\xff", r"is compressed \(gzip\)"),
        (b"PK\x03\x04\xff", "is a workbook or a zip file"),
        (b"kinematics:\n  shoulder:\n    x: 0\n", "(ur_calibration of ROS)"),
        (f"# a\n# b\n{HEADER}\n".encode(), " 2 lines .*sed '/\\^#/d' lap"),
        (f"# {HEADER}\n0,cw\n".encode(), " line 1 .*sed 's/"),
        (f"# a\n# {HEADER}\n0,cw\n".encode(), " line 2 .*sed '1,1d; s/"),
        (b"# nothing else\n", "comment"),
    ],
)
def test_other_formats_are_named(data, told):
    with pytest.raises(FileError, match=told) as error:
        parse_csv(data, "lap", "yaw", RIG)
    assert "UTF-8" not in str(error.value)


@pytest.mark.parametrize(
    ("inside", "code"),
    [
        ("<link name='b' " + " ".join(f"a{number}='1'" for number in range(200_000)) + "/>", "urdf.invalid"),
        ("".join(f"<link name='l{number}'/>" for number in range(20_000)), "file.too_large"),
    ],
    ids=["attributes", "links"],
)
def test_large_urdf_is_refused_at_once(tmp_path, inside, code):
    (tmp_path / "arm.urdf").write_text(f'<robot name="a">{inside}</robot>')
    begun = time.process_time()
    with refused(code):
        import_urdf(tmp_path / "arm.urdf")
    assert time.process_time() - begun < 10


FORMULAS = ["=cmd|' /C calc'!A0", "+1", "@SUM(A1)", "-1+1", "'=1", "\t=1", "-", "'@a"]


@pytest.mark.parametrize("text", FORMULAS)
def test_a_formula_is_written_as_text_and_read_as_it_was(text):
    assert no_formula(text).startswith("'") and as_it_was(no_formula(text)) == text


@pytest.mark.parametrize("text", ["-1.5", "-2e-05", "12", "a=b", "it's", "", "'", "'a'"])
def test_numbers_and_other_text_stay(text):
    assert no_formula(text) == text == as_it_was(text)


def test_csv_cells_and_headers_are_no_formulas():
    table = pa.table({"=head": FORMULAS, "value": [-1.0] * len(FORMULAS)})
    out = io.BytesIO()
    write_csv(table, out)
    names, *rows = csv.reader(io.StringIO(out.getvalue().decode(), newline=""))
    assert names == ["'=head", "value"]
    assert all(text[0] not in "=+-@\t" and value == "-1.0" for text, value in rows)


def test_workbook_cells_and_headers_are_no_formulas_or_links():
    texts = [*FORMULAS, "http://evil.example", "\x1b[31m"]
    table = pa.table({"=head": texts, "value": [math.nan, 0.1, *[-1.0] * (len(texts) - 2)]})
    out = io.BytesIO()
    write_xlsx(table, out)
    book = zipfile.ZipFile(out)
    sheet = book.read("xl/worksheets/sheet1.xml").decode()
    assert "<f>" not in sheet and "hyperlink" not in sheet and "\x1b" not in sheet
    assert sheet.count("<row ") == len(texts) + 1 and sheet.count("<v>") == len(texts) - 1  # what is unknown is empty


def test_more_rows_than_a_sheet_has_are_refused():
    with refused("output.invalid", "rows, but a sheet can contain"):
        write_xlsx(pa.table({"a": np.zeros(1_048_576)}), io.BytesIO())


@pytest.fixture(autouse=True)
def _read_anew():
    readers.readers.cache_clear()
    yield
    readers.readers.cache_clear()


def test_a_bag_is_recognised_by_its_first_bytes():
    assert readers.reader_of(b"t_s,q1_deg\n") is None
    for magic in (MCAP_MAGIC, SQLITE_MAGIC):
        assert readers.reader_of(magic + b"0") is bag_reader
    assert "mcap filter" in bag_reader.size_remedy(MCAP_MAGIC) and not bag_reader.size_remedy(SQLITE_MAGIC)
    assert readers.file_of(Path("table.csv")) == Path("table.csv")


def test_an_unusable_reader_is_named_with_its_remedy(monkeypatch):
    offers = EntryPoints([EntryPoint("half_made", "nowhere.at_all", "rig.readers")])
    monkeypatch.setattr(readers, "ENTRY_POINTS", offers)
    with pytest.raises(FileError) as error:
        readers.reader_of(b"t_s")
    (line,) = error.value.lines()
    assert line.startswith("reader half_made: nowhere.at_all, ")


_HEAD = '<worksheet xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main">'
_FAR = '<row r="1"><c r="A1"><v>1</v></c></row><row r="1048576"><c r="XFD1048576"><v>1</v></c></row>'
_SMALL = '<row r="1"><c r="A1"><v>7</v></c><c r="B1"><v>8</v></c></row>'
_ROWS = "".join(f'<row r="{row}"><c><v>1</v></c><c><v>2</v></c></row>' for row in range(1, 2001))


def _workbook(dimension: str, rows: str) -> bytes:
    plain, changed = io.BytesIO(), io.BytesIO()
    openpyxl.Workbook().save(plain)
    with zipfile.ZipFile(plain) as source, zipfile.ZipFile(changed, "w", zipfile.ZIP_DEFLATED) as target:
        for name in source.namelist():
            sheet = f'{_HEAD}<dimension ref="{dimension}"/><sheetData>{rows}</sheetData></worksheet>'
            target.writestr(name, sheet if name == "xl/worksheets/sheet1.xml" else source.read(name))
    return changed.getvalue()


@pytest.mark.parametrize(
    ("dimension", "rows"), [("A1:XFD1048576", _FAR), ("A1:B2000", _ROWS), ("A1:B1", _FAR.replace("XFD", "B"))]
)
def test_oversized_workbook_is_refused_while_reading(monkeypatch, dimension, rows):
    monkeypatch.setattr(raw_table, "_MOST_SHEET_CELLS", 3000)  # private: 500 000 cells take seconds
    with refused("file.too_large", "cells, in the sheet"):
        sheets_of(_workbook(dimension, rows), "book")


def test_fully_formatted_sheet_has_only_its_cells():
    assert sheets_of(_workbook("A1:XFD1048576", _SMALL), "book") == {"Sheet": b"7,8\n"}


def test_oversized_workbook_is_not_unpacked(monkeypatch):
    monkeypatch.setattr(raw_table, "_MOST_UNPACKED", 10_000)  # private: 40 MB take seconds
    with refused("file.too_large", "unpacks to more than"):
        sheets_of(_workbook("A1:B2000", _ROWS), "book")
