import os
import resource
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from daq.store import recover
from rigs.errors import CellError
from tests.support.refusals import refused
from tests.support.store_cases import crash, record, samples, start, sync

REMEDY = r"Too many open files.*; close programs or connections with open files"


@contextmanager
def no_descriptor(but: int = 0) -> Iterator[None]:
    """A process that can open no more files, but so many."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    free = [os.open("/dev/null", os.O_RDONLY) for _ in range(but + 1)]
    for fd in free:
        os.close(fd)
    resource.setrlimit(resource.RLIMIT_NOFILE, (free[but], hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


@pytest.mark.parametrize("but", [0, 1, 2])
def test_run_without_descriptors_begins_when_there_are_some(tmp_path, but):
    with no_descriptor(but), pytest.raises(CellError, match=REMEDY) as error:
        start(tmp_path)
    assert "make room" not in str(error.value)
    assert not any(tmp_path.iterdir())  # no directory without a manifest is left
    start(tmp_path).close("complete", "", {})


def test_a_run_that_cannot_go_on_asks_for_descriptors(tmp_path):
    writer = record(tmp_path)
    with no_descriptor(), pytest.raises(CellError, match=REMEDY) as error:
        writer.append("g1", samples(4))
        sync(writer)
    assert "disk" not in str(error.value)
    left = crash(writer)
    with no_descriptor(), refused("run.not_recovered"):
        recover(left)
