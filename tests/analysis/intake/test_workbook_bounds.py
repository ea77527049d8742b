from __future__ import annotations

import io
import zipfile

import openpyxl
import pytest

from analysis.intake import raw_table
from analysis.intake.raw_table import sheets_of
from tests.support.refusals import refused

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
    with refused("workbook.too_large"):
        sheets_of(_workbook(dimension, rows), "book")


def test_fully_formatted_sheet_has_only_its_cells():
    assert sheets_of(_workbook("A1:XFD1048576", _SMALL), "book") == {"Sheet": b"7,8\n"}


def test_oversized_workbook_is_not_unpacked(monkeypatch):
    monkeypatch.setattr(raw_table, "_MOST_UNPACKED", 10_000)  # private: 40 MB take seconds
    with refused("workbook.too_large"):
        sheets_of(_workbook("A1:B2000", _ROWS), "book")
