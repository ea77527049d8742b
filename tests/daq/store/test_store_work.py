import os

import pytest

from daq.store import RunWriter, load_manifest, read_run, recover, verify
from tests.support.store_cases import assert_holds, crash, samples, start


def _append(writer: RunWriter, first: int) -> None:
    writer.append("g1", samples(4, 1, first))
    writer.append("robot", samples(4, 2, first))
    writer.write()


@pytest.fixture
def ended(tmp_path):
    """A run whose chunks are full, the sync that they ended with, and more rows that came meanwhile."""
    writer = start(tmp_path, chunk_rows=4)
    _append(writer, 0)
    work = writer.begin_sync()
    _append(writer, 4)
    return writer, work


def _files(writer: RunWriter, stream: str) -> list[str]:
    return sorted(path.name for path in writer.path.glob(f"{stream}-*"))


def test_the_next_chunk_begins_when_the_disk_has_the_one_before(ended):
    writer, work = ended
    assert _files(writer, "g1") == ["g1-0001.arrow"] and writer.stored() == work.synced == {"g1": 4, "robot": 4}
    assert writer.begin_roll() is None
    work.wait()
    writer.end_work(None)
    writer.write()
    assert _files(writer, "g1") == ["g1-0001.arrow", "g1-0002.arrow"] and writer.stored() == {"g1": 8, "robot": 8}
    while rolling := writer.begin_roll():
        rolling.wait()
        writer.end_work(None)
    assert _files(writer, "g1") == ["g1-0001.parquet", "g1-0002.arrow"]


@pytest.mark.parametrize("synced", [True, False])
def test_run_ended_meanwhile_contains_the_held_back_rows(ended, synced):
    writer, work = ended
    if synced:
        work.wait()
    writer.close("complete", "", {})
    assert verify(writer.path) == []
    assert_holds(read_run(writer.path), 8)


def test_a_crash_with_two_chunks_of_a_stream(ended):
    writer, work = ended
    work.wait()
    writer.end_work(None)
    writer.write()
    path = crash(writer)
    assert not recover(path).losses
    assert_holds(read_run(path), 8)


def test_clock_step_is_saved_with_the_next_sync(tmp_path, monkeypatch):
    writer = start(tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", lambda fd: pytest.fail("waits"))
        writer.anchor()
        work = writer.begin_sync()
    assert load_manifest(writer.path).anchors == ()
    work.wait()
    writer.end_work(None)
    assert len(load_manifest(writer.path).anchors) == 1
    assert not writer.begin_sync().steps  # once
    writer.anchor()
    writer.close("complete", "", {})
    assert len(load_manifest(writer.path).anchors) == 2
