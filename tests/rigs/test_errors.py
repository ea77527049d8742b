import copy

import pytest

from rigs.errors import CellError, FileError, PathError


def test_a_message_is_one_line_that_a_terminal_can_bear():
    error = FileError("g1-0001.parquet", "columns a\nb, \x1b[31mred, Ω\ud800", "restore it")
    assert str(error) == r"g1-0001.parquet: columns a\nb, \x1b[31mred, Ω\ud800; restore it"


def test_long_message_keeps_place_and_remedy():
    said = str(FileError("g1-0001.parquet", "columns " + "x" * 50_000, "restore it"))
    assert said.startswith("g1-0001.parquet: columns") and said.endswith("xx; restore it") and len(said) < 1010


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (FileError("a.csv", "lacks x", "add it"), "file"),
        (FileError("a.csv", "lacks x", "add it", code="table.column_missing"), "table.column_missing"),
        (PathError("ur10", "too fast", "drive slower", "speed"), "path.speed"),
        (
            copy.copy(CellError("p1", "is silent", "plug it", code="gauge.silent")),
            "gauge.silent",
        ),
    ],
)
def test_an_error_has_the_code_of_its_kind_or_its_own(error, code):
    assert error.to_dict() == {
        "code": code, "where": error.where, "what": error.what, "remedy": error.remedy, "exit_code": error.exit_code,
    }  # fmt: skip
