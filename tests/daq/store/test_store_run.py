import ctypes
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daq.store import RunWriter, durable, load_manifest, new_manifest, read_run, recover, verify
from daq.store.ledger import sha256
from rigs.errors import FileError
from tests.support.nightly import examples
from tests.support.refusals import refused
from tests.support.store_cases import (
    RIG_TEXT,
    assert_holds,
    edit_chunk,
    edit_manifest,
    fault,
    finished,
    ledger_records,
    put_ledger,
    record,
    samples,
    start,
    write_and_sync,
)


def test_round_trip(run):
    read = read_run(run)
    assert_holds(read, 20)
    assert [(f["stream"], f["kind"], f["count"]) for f in read.faults] == [
        ("g1", "garbled", n) for n in (1, 2, 3, 4, 5)
    ]
    assert verify(run) == []


def test_manifest_is_complete(run):
    manifest = load_manifest(run)
    assert (manifest.rig_text, manifest.rig_sha256) == (RIG_TEXT, sha256(RIG_TEXT.encode()))
    assert (manifest.exit_status, manifest.reason) == ("complete", "asked")
    assert [(c.file, c.rows, c.first_ns, c.last_ns) for c in manifest.chunks_of("g1")] == [
        ("g1-0001.parquet", 8, 10, 7020),
        ("g1-0002.parquet", 8, 8010, 15020),
        ("g1-0003.parquet", 4, 16010, 19020),
    ]
    assert manifest.ended is not None
    assert manifest.started <= manifest.ended
    assert str(run.parent) not in (run / "manifest.json").read_text()


def test_two_runs_never_share_a_directory(tmp_path):
    paths = {finished(tmp_path, 1) for _ in range(3)}
    assert len(paths) == 3
    assert all(re.fullmatch(r"\d{8}T\d{6}Z_yaw-cw(\.\d)?", path.name) for path in paths)


def test_run_without_a_row(tmp_path):
    writer = start(tmp_path)
    write_and_sync(writer)
    writer.close("interrupted", "stopped", {})
    assert_holds(read_run(writer.path), 0)
    assert verify(writer.path) == []


def test_chunks_rotate_by_age(tmp_path, monkeypatch):
    monkeypatch.setattr("daq.store.writer.CHUNK_AGE_NS", 0)
    path = finished(tmp_path, batches=3, chunk_rows=1000)
    assert len(load_manifest(path).chunks_of("robot")) == 3
    assert_holds(read_run(path), 12)


@pytest.mark.parametrize("name", ["", "../up", "a/b", ".hidden", "a\n", "\udcff"])
def test_bad_names_are_refused(tmp_path, name):
    common = {"test": "yaw", "direction": None, "rig_name": "r", "rig_text": "", "operator": ""}
    with pytest.raises(FileError):
        RunWriter.create(tmp_path, new_manifest(name=name, streams={"g1": ("g1_mm",)}, **common))
    for streams in ({"faults": ()}, {name: ("x",)}, {"g1": ("x", "x")}, {"g1": ("status",)}):
        with pytest.raises(FileError):
            RunWriter.create(tmp_path, new_manifest(name="ok", streams=streams, **common))
    assert list(tmp_path.iterdir()) == []


def test_synced_rows_are_on_the_disk(tmp_path, monkeypatch):
    synced: dict[str, object] = {}

    def fsync(fd: int) -> None:
        path = Path(f"/proc/self/fd/{fd}").readlink()
        synced[path.name] = {file.name for file in path.iterdir()} if path.is_dir() else path.stat().st_size

    monkeypatch.setattr(os, "fsync", fsync)
    writer = start(tmp_path)
    assert writer.path.name in synced[tmp_path.name]
    for i in range(3):
        writer.append("g1", samples(4, 1, 4 * i))
        writer.append_faults("g1", [fault()])
        write_and_sync(writer)
        for name in ("g1-0001.arrow", "faults-0001.arrow"):
            assert synced[name] == (writer.path / name).stat().st_size
            assert name in synced[writer.path.name]
    writer.close("complete", "", {})
    assert {"manifest.json", "g1-0001.parquet"} <= synced[writer.path.name]


def test_recording_run_is_neither_read_nor_recovered(tmp_path):
    writer = record(tmp_path)
    for refuse in (read_run, recover):
        with refused("run.in_use", "is being recorded"):
            refuse(writer.path)
    writer.close("complete", "", {})
    assert_holds(read_run(writer.path), 12)


def test_missing_run_and_manifest(tmp_path):
    for act in (read_run, recover):
        with refused("run.missing", "no such file or directory"):
            act(tmp_path / "none")
    with refused("file.unreadable", "File name too long"):
        read_run(tmp_path / ("x" * 300))
    with refused("run.missing", "contains no run"):
        read_run(tmp_path)
    assert "no run" in verify(tmp_path)[0]


def test_flipped_bit_in_parquet(run):
    file = run / "g1-0002.parquet"
    data = bytearray(file.read_bytes())
    for place in range(0, len(data), 97):
        data[place] ^= 4
        file.write_bytes(data)
        assert "g1-0002.parquet: has changed" in verify(run)[0]
        with refused("run.damaged", "has changed since the recording"):
            read_run(run)
        data[place] ^= 4


def _no_parquet(run: Path) -> None:
    (run / "g1-0002.parquet").write_bytes(b"PAR1")
    edit_chunk(run, "g1-0002.parquet", {"sha256": sha256(b"PAR1")})


def _no_text(run: Path) -> None:
    """Found by scripts/dev fuzz: Arrow reads it, and raises only where a row of it is asked for."""
    file = run / "faults-0001.parquet"
    file.write_bytes(file.read_bytes().replace("–".encode(), b"\xff\x80\x93"))
    edit_chunk(run, file.name, {"sha256": sha256(file.read_bytes())})


@pytest.mark.parametrize(
    ("damage", "code", "says"),
    [
        (lambda run: (run / "robot-0003.parquet").unlink(), "run.damaged", "robot-0003.parquet"),
        (lambda run: edit_chunk(run, "g1-0002.parquet", {"rows": 7}), "run.damaged", "has 8 rows"),
        (lambda run: edit_chunk(run, "g1-0002.parquet", {"file": "../run/g1-0002.parquet"}), "run.damaged", ""),
        (
            lambda run: edit_manifest(run, {"streams": {"g1": ["g1_um"], "robot": ["q1_deg", "q2_deg"]}}),
            "run.damaged",
            "",
        ),
        (lambda run: (run / "manifest.json").write_bytes(b"[" * 100_000), "run.damaged", ""),
        (_no_parquet, "run.damaged", "g1-0002.parquet"),
        (_no_text, "run.damaged", "faults-0001.parquet"),
    ],
    ids=["deleted chunk", "row count", "file of another run", "columns", "nested manifest", "no Parquet", "no text"],
)
def test_damaged_run_is_refused_and_its_damage_named(run, damage, code, says):
    damage(run)
    assert any(says in line for line in verify(run))
    with refused(code):
        read_run(run)


def test_left_over_files_and_rig_text(run):
    shutil.copy(run / "g1-0001.parquet", run / "g1-0009.parquet")
    edit_manifest(run, {"rig_text": "other"})
    text = "\n".join(verify(run))
    assert "g1-0009.parquet: " in text
    assert "rig file" in text


JUNK = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)


@examples(40, 150)
def test_mutated_manifest_raises_only_file_errors(whole, run, examples):
    @settings(max_examples=examples)
    @given(data=st.data())
    def holds(data: st.DataObject) -> None:
        for name in ("manifest.json", "ledger.jsonl"):
            shutil.copy(whole / name, run / name)
        how = data.draw(st.sampled_from(["bytes", "cut", "key", "record"]))
        if how == "key":
            key = data.draw(st.sampled_from(sorted(json.loads((run / "manifest.json").read_bytes()))))
            edit_manifest(run, {key: data.draw(JUNK)})
        elif how == "record":
            records = ledger_records(run)
            (target,) = data.draw(st.sampled_from(records[1:])).values()
            target[data.draw(st.sampled_from(sorted(target)))] = data.draw(JUNK)
            put_ledger(run, records)
        else:
            file = run / data.draw(st.sampled_from(["manifest.json", "ledger.jsonl"]))
            good = file.read_bytes()
            place = data.draw(st.integers(0, len(good) - 1))
            rest = good[place + 1 :] if how == "bytes" else b""
            file.write_bytes(good[:place] + data.draw(st.binary(max_size=3)) + rest)
        problems = verify(run)
        assert all("\n" not in problem for problem in problems)
        try:
            assert_holds(read_run(run), 20)
        except FileError as error:
            assert "\n" not in str(error)
        except AssertionError:
            assert problems  # other rows than were recorded and verify saw nothing

    holds()


def test_lock_look_leaves_no_trace(tmp_path):
    assert not durable.is_locked(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_reading_leaves_no_thread_behind(whole):
    """A thread of Arrow's that is at work when Python ends aborts the program (arrow issue 34314)."""
    show = (
        "import os, sys; from pathlib import Path; from daq.store import read_run, verify;"
        "run = Path(sys.argv[1]); read_run(run); verify(run); task = Path('/proc/self/task');"
        "print(*sorted((one / 'comm').read_text().strip() for one in task.iterdir()), sep='\\n')"
    )
    command, alone = [sys.executable, "-c", show, whole], os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    threads = subprocess.run(command, capture_output=True, text=True, check=True, env=alone)
    assert [name for name in threads.stdout.split() if name != "jemalloc_bg_thd"] == [Path(sys.executable).name]


def test_directory_of_runs_differs_from_a_run_without_manifest(tmp_path):
    path = finished(tmp_path / "runs")
    with refused("run.missing", "run but a directory of runs"):
        read_run(path.parent)
    (tmp_path / "empty").mkdir()
    with refused("run.missing", "contains no run"):
        read_run(tmp_path / "empty")
    (path / "manifest.json").unlink()
    with refused("run.damaged", "has no manifest"):
        read_run(path)


def test_a_run_that_is_named_without_its_time_is_suggested(tmp_path):
    run = tmp_path / "20261124T020526Z_trial-acw"
    run.mkdir()
    for what in (read_run, recover):
        with refused("run.missing", "no such file or directory"):
            what(tmp_path / "trial-acw")
    (tmp_path / "20261125T020526Z_trial-acw").mkdir()  # either may be meant
    with refused("run.missing", "no such file or directory"):
        read_run(tmp_path / "trial-acw")
    (tmp_path / "trial").touch()
    with refused("run.missing", "is a file, not the directory"):
        read_run(tmp_path / "trial")


MAPPED = """
import ctypes
from daq.store.run_directory import keep_large_blocks_apart

class Info(ctypes.Structure):
    _fields_ = [(name, ctypes.c_size_t) for name in "arena ordblks smblks hblks hblkhd usmblks fsmblks".split()]
    _fields_ += [(name, ctypes.c_size_t) for name in "uordblks fordblks keepcost".split()]

libc = ctypes.CDLL(None)
libc.mallinfo2.restype = Info
{}
chunk = bytes(20 << 20)
del chunk
before = libc.mallinfo2().hblkhd
block = bytes(4 << 20)
print(libc.mallinfo2().hblkhd - before >> 20)
"""


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "mallinfo2"), reason="glibc before 2.33")
@pytest.mark.parametrize(("called", "mapped_mib"), [("", "0"), ("keep_large_blocks_apart()", "4")])
def test_after_a_chunk_large_blocks_are_still_mapped_by_themselves(called, mapped_mib):
    done = subprocess.run([sys.executable, "-c", MAPPED.format(called)], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == mapped_mib


def test_the_first_rows_import_nothing():
    """An import would hold up the thread that drains the readers, as that of pandas did."""
    script = """
import sys, numpy as np, pyarrow as pa
from daq.recording.io_worker import IoWorker
from daq.recording.warnings import RateLimitedLog

IoWorker(RateLimitedLog())
before = set(sys.modules)
pa.array(np.arange(3.0)), pa.array(["silent"], pa.string())
print(sorted(set(sys.modules) - before))
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
