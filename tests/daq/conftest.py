from collections.abc import Iterator
from pathlib import Path

import pytest

from daq.store import durable
from tests.support.bench import Bench
from tests.support.recorders import Gate


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    with Bench(tmp_path) as made:
        yield made


@pytest.fixture
def gate() -> Iterator[Gate]:
    made = Gate()
    yield made
    made.open()


@pytest.fixture
def making(gate: Gate, monkeypatch: pytest.MonkeyPatch) -> Gate:
    """A disk that makes no directory for a run before the gate is open."""
    monkeypatch.setattr(durable, "make_directory", gate.before(durable.make_directory))
    return gate
