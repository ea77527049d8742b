"""The same table in other formats, and tables that are damaged, cut off or imprecise."""

import io
import json
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from analysis.intake.converted import csv_of
from analysis.intake.imports import RunLabels, read_any_table
from analysis.intake.read import read_file
from analysis.intake.table_files import cut_off_doubts
from analysis.robot.kinematics.arm import arm_of, forward, rotation
from rigs.load import load
from tests.support.refusals import refused

ROWS = 24
DICE = np.random.default_rng(8)
JOINTS_DEG = DICE.uniform(-90, 90, (ROWS, 6)).round(6)
Columns = Mapping[str, np.ndarray]


def _places_mm() -> np.ndarray:
    exact_mm = forward(arm_of(load("ur10e")[0].robot), np.radians(JOINTS_DEG))[:, :3, 3]
    turn = rotation(np.array([0.2, -0.4, 1.1]))  # the frame of a tracker
    return exact_mm @ turn.T + [1500.0, -300.0, 400.0] + np.random.default_rng(9).normal(0, 0.1, exact_mm.shape)


@pytest.fixture(scope="module")
def columns() -> Columns:
    names = [*(f"q{axis}_deg" for axis in range(1, 7)), "x_mm", "y_mm", "z_mm"]
    return dict(zip(names, np.hstack([JOINTS_DEG, _places_mm()]).T, strict=True))


@pytest.fixture(scope="module")
def lists() -> Columns:
    return {"observation.state": np.radians(JOINTS_DEG), "position": _places_mm() / 1000}


def _parquet(table: pa.Table) -> bytes:
    out = io.BytesIO()
    pq.write_table(table, out)
    return out.getvalue()


def _npz(save: Callable[..., None] = np.savez, **arrays: object) -> bytes:
    out = io.BytesIO()
    save(out, **arrays)
    return out.getvalue()


def _lines(rows: list[object], end: str = "\n") -> bytes:
    return "".join(json.dumps(row) + end for row in rows).encode()


def _rows(columns: Columns) -> list[dict[str, object]]:
    return [{name: column[row].tolist() for name, column in columns.items()} for row in range(ROWS)]


def _cells(lists: Columns, join: str, end: str = "\n") -> bytes:
    rows = [
        ",".join(f'"[{join.join(f"{value:.8f}" for value in column[row])}]"' for column in lists.values())
        for row in range(ROWS)
    ]
    return end.join([",".join(lists), *rows, ""]).encode()


def _fixed(column: np.ndarray) -> pa.Array:
    return pa.FixedSizeListArray.from_arrays(pa.array(column.ravel()), column.shape[1])


PLAIN: dict[str, Callable[[Columns], bytes]] = {
    "parquet": lambda columns: _parquet(pa.table(dict(columns))),
    "parquet, single precision": lambda columns: _parquet(
        pa.table({name: column.astype(np.float32) for name, column in columns.items()})
    ),
    "parquet with text": lambda columns: _parquet(
        pa.table({name: column.astype(str) for name, column in columns.items()})
    ),
    "npz": lambda columns: _npz(**columns),
    "npz, compressed, with a remark": lambda columns: _npz(np.savez_compressed, **columns, note=np.array("of today")),
    "JSON lines": lambda columns: _lines(_rows(columns)),
    "JSON lines with CR LF and a blank line": lambda columns: b"\r\n" + _lines(_rows(columns), "\r\n"),
}
"""Writers of a table with a column for each number, by format."""

WITH_LISTS: dict[str, Callable[[Columns], bytes]] = {
    "parquet": lambda lists: _parquet(pa.table({name: column.tolist() for name, column in lists.items()})),
    "parquet, fixed size": lambda lists: _parquet(pa.table({name: _fixed(column) for name, column in lists.items()})),
    "parquet, nested": lambda lists: _parquet(pa.table({"data": _rows(lists)})),
    "npz": lambda lists: _npz(**lists),
    "npz, with metadata": lambda lists: _npz(**lists, start=np.arange(3), rate_hz=np.float64(30)),
    "JSON lines": lambda lists: _lines(_rows(lists)),
    "JSON lines, nested": lambda lists: _lines([{"data": row} for row in _rows(lists)]),
    "cells": lambda lists: _cells(lists, ", "),
    "cells with blanks": lambda lists: _cells(lists, " "),
    "cells with CR LF": lambda lists: _cells(lists, ",", "\r\n"),
    "cells with a byte order mark": lambda lists: b"\xef\xbb\xbf" + _cells(lists, ","),
}


def _read(tmp_path: Path, data: bytes) -> tuple[np.ndarray, np.ndarray]:
    file = tmp_path / "table"
    file.write_bytes(data)
    table = read_any_table(file, "ur10e", "pose", RunLabels()).table
    return np.degrees(table.q), table.readings


@pytest.mark.parametrize("name", PLAIN)
def test_table_in_another_format_is_read_as_its_csv(tmp_path, columns, name):
    joints_deg, readings_mm = _read(tmp_path, PLAIN[name](columns))
    np.testing.assert_allclose(joints_deg, JOINTS_DEG, atol=1e-5)
    np.testing.assert_allclose(readings_mm[:, :3], _places_mm(), atol=1e-3)


@pytest.mark.parametrize("name", WITH_LISTS)
def test_lists_become_columns(tmp_path, lists, name):
    joints_deg, readings_mm = _read(tmp_path, WITH_LISTS[name](lists))
    np.testing.assert_allclose(joints_deg, JOINTS_DEG, atol=1e-5)
    np.testing.assert_allclose(readings_mm[:, :3], _places_mm(), atol=1e-3)


@pytest.mark.parametrize("name", ["parquet", "npz"])
def test_damaged_file_is_one_error(tmp_path, columns, name):
    whole = PLAIN[name](columns)
    for cut in (60, len(whole) // 2, len(whole) - 5):
        with refused("file.invalid"):
            _read(tmp_path, whole[:cut])


@pytest.mark.parametrize("rows", [[{"a": [1, 2]}, {"a": [1]}], [{"a": [1, 2]}, {"a": None}]])
def test_lists_of_different_length_are_refused(tmp_path, rows):
    with refused("table.invalid"):
        _read(tmp_path, _lines(rows))


@pytest.mark.parametrize(
    "data",
    [b'a,a,b\n3,4,"[1, 2]"\n', b'a,a_1\n"[1, 2]",3\n', _lines([{"a": [1, 2], "a_1": 3}] * 2)],
    ids=["header", "cells", "JSON lines"],
)
def test_two_columns_of_one_name_are_refused(data):
    with refused("table.invalid"):
        csv_of(data, "table")


def test_pickled_objects_are_not_loaded(tmp_path):
    with refused("file.invalid"):
        _read(tmp_path, _npz(q1_deg=np.array([{}, {}], dtype=object)))


@pytest.mark.parametrize("text", ["1e-400", "-3.5e-330", "0.01e-399", "7E-999", "+.5e-350"])
def test_number_too_small_to_represent_is_not_zero(tmp_path, columns, text):
    table = [",".join(columns), *(",".join(map(str, row)) for row in zip(*columns.values(), strict=True))]
    for column, code in ((text, "table.invalid"), ("0e-400", None), ("0.000", None)):
        row = f"{column},{table[1].partition(',')[2]}"
        (tmp_path / "t.csv").write_text("\n".join([table[0], row, *table[2:], ""]))
        if code:
            with refused(code):
                read_file(tmp_path / "t.csv", "pose", load("ur10e")[0])
        else:
            read_file(tmp_path / "t.csv", "pose", load("ur10e")[0])


TEXT = "q1_deg,x_mm\n" + "".join(f"{k}.25,{100 + k}.125\n" for k in range(9))


@pytest.mark.parametrize(
    "text",
    [
        TEXT[:-2],
        TEXT[:-4],
        TEXT[:-5],
        TEXT.replace(".125", "")[:-2],
        TEXT.replace(",", ";").replace(".", ",")[:-3],
        TEXT.replace("\n", "\r\n")[:-4],
        TEXT.replace(",", "\t")[:-3],
    ],
)
def test_table_cut_in_its_last_number_is_doubted(text):
    (doubt,) = cut_off_doubts(text.encode())
    assert "cut off" in doubt


@pytest.mark.parametrize(
    "text", [TEXT, TEXT[:-1], TEXT.replace("8.125", "8.1"), "a,b\n1,2.5\n1,2", "", "a", "1.", TEXT + '"text 5"']
)
def test_whole_table_is_not_doubted(text):
    assert cut_off_doubts(text.encode()) == ()


def test_cut_table_is_read_with_its_doubt(tmp_path, columns):
    table = [",".join(columns), *(",".join(f"{one:.5f}" for one in row) for row in zip(*columns.values(), strict=True))]
    (tmp_path / "t.csv").write_text("\n".join(table)[:-2])
    doubts = read_any_table(tmp_path / "t.csv", "ur10e", "pose", RunLabels()).doubts
    assert any("cut off" in doubt for doubt in doubts)
