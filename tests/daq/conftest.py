import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from daq.store import durable
from tests.support.bench import Bench


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    with Bench(tmp_path) as made:
        yield made


@pytest.fixture
def making(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[threading.Event, threading.Event]]:
    """A disk that makes no directory for a run: set when one is asked for; to be set when it may go on."""
    asked, done = threading.Event(), threading.Event()

    def slow(path: Path, make: Callable[[Path], None] = durable.make_directory) -> None:
        asked.set()
        assert done.wait(60)
        make(path)

    monkeypatch.setattr(durable, "make_directory", slow)
    try:
        yield asked, done
    finally:
        done.set()
