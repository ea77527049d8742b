import csv
import io
import math
import time
import zipfile

import numpy as np
import pyarrow as pa
import pytest

from analysis.apps.interchange.urdf import import_urdf
from analysis.intake.read import parse_csv
from analysis.runs.written_files import as_it_was, no_formula, write_csv, write_xlsx
from rigs.errors import FileError
from rigs.load import load
from tests.support.refusals import refused
from tests.support.table_cases import csv_text, plain

RIG = load("ur10e")[0]
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


def test_an_element_of_many_attributes_is_refused_at_once(tmp_path):
    attributes = " ".join(f'a{number}="1"' for number in range(200_000))
    (tmp_path / "arm.urdf").write_text(f'<robot name="a"><link name="b" {attributes}/></robot>')
    begun = time.process_time()
    with refused("urdf.too_large"):
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
    with refused("output.form"):
        write_xlsx(pa.table({"a": np.zeros(1_048_576)}), io.BytesIO())


def test_notes_of_a_table_come_back(tmp_path):
    lines = csv_text(plain("roll", "cw")).splitlines()
    notes = [FORMULAS[0], "+1", *["fine"] * (len(lines) - 3)]
    text = "\n".join([f"{lines[0]},note", *(f'{line},"{note}"' for line, note in zip(lines[1:], notes, strict=True))])
    table = parse_csv(text.encode(), "lap.csv", "roll", RIG)
    out = io.BytesIO()
    write_csv(table, out)
    assert b"'=cmd" in out.getvalue()
    assert parse_csv(out.getvalue(), "lap.csv", "roll", RIG)["note"].to_pylist() == notes
