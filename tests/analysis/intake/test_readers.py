from __future__ import annotations

from collections.abc import Iterator
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from analysis.apps.interchange import bag_reader
from analysis.apps.interchange.bags import MCAP_MAGIC, SQLITE_MAGIC
from analysis.intake import readers
from rigs.errors import FileError


@pytest.fixture(autouse=True)
def _read_anew() -> Iterator[None]:
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
    offers = [EntryPoint("half_made", "nowhere.at_all", "rig.readers")]
    monkeypatch.setattr(readers, "entry_points", lambda group: offers)
    with pytest.raises(FileError) as error:
        readers.reader_of(b"t_s")
    (line,) = error.value.lines()
    assert line.startswith("reader half_made: nowhere.at_all, ")
