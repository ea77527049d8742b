"""Error messages are safe for any content of a damaged file."""

from __future__ import annotations

from rigs.errors import FileError


def test_a_message_is_one_line_that_a_terminal_can_bear() -> None:
    error = FileError("g1-0001.parquet", "holds the columns a\nb, \x1b[31mred, Ω\ud800", "restore the file")
    assert str(error) == r"g1-0001.parquet: holds the columns a\nb, \x1b[31mred, Ω\ud800; restore the file"


def test_a_message_that_is_too_long_keeps_where_and_what_to_do() -> None:
    said = str(FileError("g1-0001.parquet", "holds the columns " + "x" * 50_000, "restore the file"))
    assert said.startswith("g1-0001.parquet: holds") and said.endswith("xx; restore the file") and len(said) < 1010
