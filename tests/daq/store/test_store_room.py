import math
import struct
from random import Random

import pytest

import daq.store.run_directory
import daq.store.writer
from daq.protocol.conversation import Sample
from daq.store import NearlyFull, load_manifest, read_run, verify
from daq.store.run_directory import MARGIN_BYTES
from tests.support.powercut import BLOCK, watched
from tests.support.refusals import refused
from tests.support.store_cases import assert_holds, record, samples, start, sync, write_and_sync


def wild(count: int, width: int, random: Random) -> list[Sample]:

    def double() -> float:
        value: float = struct.unpack("<d", random.randbytes(8))[0]
        return 0.0 if math.isnan(value) else value

    def whole(bits: int) -> int:
        return random.getrandbits(bits)

    return [
        Sample(tuple(double() for _ in range(width)), whole(62), whole(62), whole(62), whole(30), double(), whole(30))
        for _ in range(count)
    ]


@pytest.mark.parametrize(("batches", "rows"), [(1, 1), (1, 2000), (200, 5), (5, 1000)])
@pytest.mark.parametrize("rig_text", ["", "x" * 100_000])
@pytest.mark.parametrize("synced", [True, False])
def test_closing_needs_no_more_room_than_reserved(tmp_path, batches, rows, rig_text, synced):
    random = Random(1)
    with watched(tmp_path) as disk:
        writer = start(tmp_path / "runs", 10**9, rig_text)
        for _ in range(batches):
            writer.append("g1", wild(rows, 1, random))
            writer.append("robot", wild(rows, 2, random))
            if synced:
                write_and_sync(writer)
        said, before = writer.room_to_close(), disk.used
        disk.peak = 0
        writer.close("complete", "", {})
        blocks = 2 * BLOCK * len(writer.manifest.all_streams)
        assert disk.peak - before <= said + blocks < MARGIN_BYTES


def test_a_recording_ends_whole_before_the_disk_is_full(tmp_path, monkeypatch):
    monkeypatch.setattr(daq.store.writer, "MARGIN_BYTES", 16 * BLOCK)
    monkeypatch.setattr(daq.store.run_directory, "TO_BEGIN_BYTES", 32 * BLOCK)
    with watched(tmp_path, capacity=1_000_000) as disk:
        writer, rows = start(tmp_path / "runs", 10**9), 0
        with refused("disk.full", "disk nearly full"):
            while True:
                writer.append("g1", samples(40, 1, rows))
                writer.append("robot", samples(40, 2, rows))
                rows += 40
                write_and_sync(writer)
        writer.close("interrupted", "nearly full", {"g1": {}})
        assert disk.peak > 500_000  # most of the room was used
    assert verify(writer.path) == []
    assert_holds(read_run(writer.path), rows)
    assert load_manifest(writer.path).counters == {"g1": {"samples": rows}}


def test_no_run_begins_on_a_disk_that_is_nearly_full(tmp_path):
    with watched(tmp_path, capacity=60 << 20), pytest.raises(NearlyFull):
        record(tmp_path / "runs")
    assert list((tmp_path / "runs").iterdir()) == []


def test_a_run_may_have_any_number_of_chunks(tmp_path):
    with watched(tmp_path):
        writer, rows = start(tmp_path, chunk_rows=4), 0
        manifest, ledger, lines = (writer.path / "manifest.json").read_bytes(), b"", []
        while rows < 4 * 60:
            writer.append("g1", samples(4, 1, rows))
            writer.append("robot", samples(4, 2, rows))
            rows += 4
            sync(writer)
            before, ledger = ledger, (writer.path / "ledger.jsonl").read_bytes()
            assert ledger.startswith(before)
            lines.append(len(ledger) - len(before))
        writer.close("complete", "enough", {})
    assert max(lines[1:]) < 1.1 * min(lines[1:])
    assert (writer.path / "manifest.json").read_bytes() == manifest
    assert len(load_manifest(writer.path).chunks) == 120
    assert verify(writer.path) == []
    assert_holds(read_run(writer.path), rows)
