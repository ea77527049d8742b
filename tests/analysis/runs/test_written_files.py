import errno
import io
from pathlib import Path
from typing import BinaryIO

import pyarrow as pa
import pytest

from analysis.runs.written_files import ROWS_AT_ONCE, holding, write_all_new, write_csv, write_new
from rigs.errors import CellError
from tests.support.refusals import refused


def test_all_are_written_into_a_directory_that_is_made(tmp_path):
    paths = write_all_new(tmp_path / "new" / "below", {"a": holding(b"x"), "b": holding(b"y")})
    assert [(path.name, path.read_bytes()) for path in paths] == [("a", b"x"), ("b", b"y")]


def test_one_that_exists_leaves_all_as_they_are(tmp_path):
    (tmp_path / "b").write_bytes(b"old")
    with refused("output.exists"):
        write_all_new(tmp_path, {"a": holding(b"x"), "b": holding(b"y")})
    assert [path.name for path in tmp_path.iterdir()] == ["b"] and (tmp_path / "b").read_bytes() == b"old"


def test_a_file_that_is_not_complete_has_another_name(tmp_path):
    path, seen = tmp_path / "table.csv", []

    def look(file: BinaryIO) -> None:
        file.write(b"half")
        seen.append(path.exists())

    write_new(path, look)
    assert seen == [False] and [file.name for file in tmp_path.iterdir()] == ["table.csv"]


@pytest.mark.parametrize("path", [".", "..", "/", "/dev/null"])
def test_invalid_file_name_counts_as_existing(path):
    with refused("output.exists"):
        write_new(Path(path), holding(b"x"))


def test_file_that_another_program_writes_meanwhile_is_not_replaced(tmp_path):
    path = tmp_path / "table.csv"
    with refused("output.exists"):
        write_new(path, lambda file: path.write_bytes(b"theirs"))
    assert path.read_bytes() == b"theirs" and len(list(tmp_path.iterdir())) == 1
    path.unlink()
    write_new(path, holding(b"ours"))
    assert path.read_bytes() == b"ours"


@pytest.mark.parametrize(
    ("stopped_by", "reported_as"),
    [(KeyboardInterrupt(), KeyboardInterrupt), (OSError(errno.ENOSPC, "full"), CellError)],
)
def test_interrupted_writing_leaves_no_file(stopped_by, reported_as, tmp_path):
    def stops(file: BinaryIO) -> None:
        file.write(b"half")
        raise stopped_by

    with pytest.raises(reported_as):
        write_all_new(tmp_path, {"a": holding(b"x"), "b": stops})
    assert not list(tmp_path.iterdir())


def test_csv_in_parts_has_every_row_once_in_order():
    rows = 2 * ROWS_AT_ONCE + 3
    file = io.BytesIO()
    write_csv(pa.table({"n": range(rows), "half": [n / 2 for n in range(rows)]}), file)
    head, *lines = file.getvalue().decode().splitlines()
    assert head == "n,half" and lines == [f"{n},{n / 2!r}" for n in range(rows)]
