import errno
import os
import resource
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from daq.store import RunWriter, load_manifest, read_run, recover, verify
from daq.store.ledger import Ledger
from daq.store.stream_writer import StreamWriter
from rigs.errors import CellError
from tests.support.refusals import refused
from tests.support.store_cases import assert_holds, crash, finished, record, samples, start, sync, write_and_sync

ENVIRONMENT = os.environ | {"PYTHONPATH": str(Path(__file__).parents[3])}


def python(code: str, *arguments: object) -> list[str]:
    return [sys.executable, "-c", code, *map(str, arguments)]


def assert_recovered(path: Path, rows: int, exit_status: str = "recovered") -> None:
    assert verify(path) == []
    assert_holds(read_run(path), rows)
    assert recover(path).nothing_to_do
    assert load_manifest(path).exit_status == exit_status


def test_crash_is_recovered_once(tmp_path):
    path = crash(record(tmp_path, batches=5, chunk_rows=8))
    done = recover(path)
    assert done.rows == {"g1": 4, "robot": 4, "faults": 5}
    assert not done.losses
    assert_recovered(path, 20)
    assert load_manifest(path).counters == {"g1": {"samples": 20, "garbled": 15}, "robot": {"samples": 20}}


def test_run_of_an_external_test_needs_its_package(tmp_path):
    manifest = finished(tmp_path) / "manifest.json"
    text = manifest.read_text().replace('"yaw"', '"height"')
    manifest.write_text(text)
    for use in (load_manifest, recover):
        with refused("package.missing", "neither rig nor an installed package"):
            use(manifest.parent)
    assert manifest.read_text() == text


def test_torn_chunk_is_kept(tmp_path):
    path = crash(record(tmp_path))
    torn = (path / "g1-0001.arrow").read_bytes()[:-3]
    (path / "g1-0001.arrow").write_bytes(torn)
    done = recover(path)
    assert done.rows == {"g1": 8, "robot": 12, "faults": 3}
    assert "g1-0001.arrow.torn" in done.losses["g1-0001.arrow"]
    assert (path / "g1-0001.arrow.torn").read_bytes() == torn
    assert verify(path) == []
    assert len(read_run(path).streams["g1"]["sequence"]) == 8
    assert recover(path).nothing_to_do


def test_empty_and_foreign_files(tmp_path):
    path = crash(record(tmp_path))
    (path / "g1-0002.arrow").touch()
    (path / "g9-0001.arrow").write_bytes(b"x")
    (path / "g1-0002.parquet.tmp").write_bytes(b"half")
    done = recover(path)
    assert "no stream" in done.losses["g9-0001.arrow"]
    assert not list(path.glob("*.tmp"))
    assert_recovered(path, 12)


class Crash(BaseException):
    """Simulated power cut."""


@pytest.mark.parametrize("step", ["finish", "append", "delete_chunk"])
@pytest.mark.parametrize("when", ["before", "after"])
@pytest.mark.parametrize("nth", [1, 4])
def test_crash_while_closing_a_chunk(tmp_path, monkeypatch, step, when, nth):
    writer = record(tmp_path, batches=5, chunk_rows=8)
    owner = Ledger if step == "append" else StreamWriter
    original, calls = getattr(owner, step), iter(range(1, 100))

    def crashing(*arguments: object) -> object:
        reached = next(calls) == nth
        if reached and when == "before":
            raise Crash
        result = original(*arguments)
        if reached:
            raise Crash
        return result

    monkeypatch.setattr(owner, step, crashing)
    try:
        writer.close("complete", "asked", {})
    except Crash:
        crash(writer)
        monkeypatch.undo()
        recover(path := writer.path)
        ended = (step, when, nth) == ("append", "after", 4)
        assert_recovered(path, 20, "complete" if ended else "recovered")
    else:
        assert (step, nth) in {("finish", 4), ("delete_chunk", 4)}  # three streams close three chunks


@pytest.mark.parametrize("nth", range(1, 6))
def test_recovery_may_itself_be_interrupted(tmp_path, monkeypatch, nth):
    path = crash(record(tmp_path))
    (path / "manifest.json").write_bytes(b"{")
    renames, rename = iter(range(1, 100)), os.replace

    def crashing(old: Path, new: Path) -> None:
        if next(renames) == nth:
            raise Crash
        return rename(old, new)

    monkeypatch.setattr(os, "replace", crashing)
    with pytest.raises(Crash):
        recover(path)
    monkeypatch.undo()
    recover(path)
    assert_recovered(path, 12)


def test_damaged_parquet_with_its_recording_chunk(tmp_path):
    path = crash(record(tmp_path))
    (path / "g1-0001.parquet").write_bytes(b"PAR1 half a file")
    assert "g1-0001.parquet" in recover(path).losses
    assert (path / "g1-0001.parquet.torn").exists()
    assert_recovered(path, 12)


def test_whole_parquet_is_not_replaced_by_a_torn_recording_chunk(tmp_path):
    writer = record(tmp_path)
    # private: the run is left between two steps of closing a chunk
    stream_writer = writer._writers["g1"]
    stream_writer.finish(stream_writer.unclosed()[0])
    path = crash(writer)
    (path / "g1-0001.arrow").write_bytes(b"torn")
    recover(path)
    assert_recovered(path, 12)


@pytest.mark.parametrize("damage", [None, b"", b"{", b"\xff\xfe"])
@pytest.mark.parametrize("end", [crash, RunWriter.close])
def test_lost_manifest_is_rebuilt(tmp_path, damage, end):
    writer = record(tmp_path, batches=5, chunk_rows=8)
    opening = writer.manifest.opening()
    if end is crash:
        crash(writer)
    else:
        writer.close("complete", "", {})
    (writer.path / "manifest.json").unlink()
    if damage is not None:
        (writer.path / "manifest.json").write_bytes(damage)
    recover(writer.path)
    assert_recovered(writer.path, 20)
    assert load_manifest(writer.path).opening() == opening
    assert (writer.path / "manifest.json.torn").exists() == (damage is not None)


def test_temporarily_unreadable_manifest_is_kept(tmp_path, monkeypatch):
    path = finished(tmp_path)
    before = load_manifest(path)

    given = os.open

    def refuse(file: Path, *flags: int) -> int:
        if file.name == "manifest.json":
            raise OSError(errno.EIO, "Input/output error")
        return given(file, *flags)

    with monkeypatch.context() as patch:
        patch.setattr(os, "open", refuse)
        with refused("run.damaged", "cannot be recovered"):
            recover(path)
    assert load_manifest(path) == before and verify(path) == []


def test_lost_manifest_without_a_chunk_is_reported(tmp_path):
    path = crash(record(tmp_path, batches=0))
    (path / "manifest.json").unlink()
    with refused("run.damaged", "description of the run are missing"):
        recover(path)


KILLED = """
import sys
from pathlib import Path
from tests.support.store_cases import samples, fault, start, sync
writer = start(Path(sys.argv[1]), chunk_rows=40)
print(writer.path, flush=True)
for i in range(10**9):
    writer.append("g1", samples(4, 1, 4 * i))
    writer.append("robot", samples(4, 2, 4 * i))
    sync(writer)
    print(4 * (i + 1), flush=True)
"""


@pytest.mark.parametrize("lines", [1, 7, 40])
def test_kill_9_keeps_all_that_was_synced(tmp_path, lines):
    with subprocess.Popen(python(KILLED, tmp_path), stdout=subprocess.PIPE, text=True, env=ENVIRONMENT) as child:
        path = Path(child.stdout.readline().strip())
        for _ in range(lines):
            child.stdout.readline()
        with refused("run.in_use", "is being recorded"):
            recover(path)
        child.kill()
        synced = max(4 * lines, *(int(line) for line in child.stdout if line.endswith("\n")), 0)
    recover(path)
    read = read_run(path)
    g1, robot = len(read.streams["g1"]["sequence"]), len(read.streams["robot"]["sequence"])
    assert synced <= robot <= g1 <= synced + 4
    assert verify(path) == []
    assert recover(path).nothing_to_do
    if g1 == robot:
        assert_holds(read, g1)


FULL = """
import resource, signal, sys
from pathlib import Path
from tests.support.store_cases import samples, start, write_and_sync
from daq.store import RunWriter
from daq.store import durable
from rigs.errors import CellError
durable.free_bytes = lambda path: 1 << 40  # as where a quota is what limits: the disk seems to have room
if len(sys.argv) > 2:
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), resource.RLIM_INFINITY))
writer = start(Path(sys.argv[1]), chunk_rows=10**9)
print(writer.path)
synced = 0
try:
    for i in range(10**6):
        writer.append("g1", samples(4, 1, 4 * i))
        writer.append("robot", samples(4, 2, 4 * i))
        write_and_sync(writer)
        synced = 4 * (i + 1)
except CellError as error:
    print(error)
for again in (RunWriter.write, write_and_sync):
    try:
        again(writer)
        print("no error")
    except CellError as error:
        print(error)
print(synced)
try:
    writer.close("failed", "the disk is full", {})
    print("closed")
except CellError as error:
    print(error)
"""


def run_full(command: list[str]) -> tuple[Path, int, str]:
    child = subprocess.run(command, capture_output=True, text=True, env=ENVIRONMENT, check=False)
    assert child.returncode == 0, child.stderr
    assert not child.stderr
    path, *errors, synced, closed = child.stdout.splitlines()
    assert len(errors) == 3
    assert all(error.startswith(f"{path}: cannot be written: ") for error in errors)
    return Path(path), int(synced), closed


@pytest.mark.parametrize("limit", [2000, 3000, 4001, 20_000])
def test_file_that_may_not_grow(tmp_path, limit):
    path, synced, closed = run_full(python(FULL, tmp_path, limit))
    if closed != "closed":
        assert closed.startswith(f"{path}: ")
        assert not recover(path).nothing_to_do
    assert verify(path) == []
    read = read_run(path)
    g1, robot = (len(read.streams[stream]["sequence"]) for stream in ("g1", "robot"))
    assert synced <= robot <= g1 <= synced + 4
    assert load_manifest(path).reason == "the disk is full"
    assert load_manifest(path).exit_status == ("failed" if closed == "closed" else "recovered")


def test_failed_fsync_condemns_the_writer(tmp_path, monkeypatch):
    writer = record(tmp_path)
    writer.append("g1", samples(4, 1, 12))

    def broken(fd: int) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(os, "fsync", broken)
    with refused("output.not_writable", "cannot be written"):
        write_and_sync(writer)
    monkeypatch.undo()
    with refused("output.not_writable", "cannot be written"):
        write_and_sync(writer)
    writer.close("failed", "broken", {})
    assert verify(writer.path) == []
    assert len(read_run(writer.path).streams["g1"]["sequence"]) == 16


def test_a_run_that_could_not_be_closed_is_not_complete(tmp_path, monkeypatch):
    writer = record(tmp_path)
    monkeypatch.setattr("daq.store.stream_writer.to_parquet", refuse)
    with refused("output.not_writable", "No space left on device"):
        writer.close("complete", "asked", {"g1": {"samples": 12}})
    monkeypatch.undo()
    assert load_manifest(writer.path).exit_status == "failed"
    with refused("run.in_use", "the recording crashed"):
        read_run(writer.path)
    recover(writer.path)
    assert_recovered(writer.path, 12)
    assert load_manifest(writer.path).reason == f"asked; {os.strerror(errno.ENOSPC)}"


def test_chunk_that_could_not_be_closed_is_closed_at_the_end(tmp_path, monkeypatch):
    writer = record(tmp_path, batches=1, chunk_rows=8)
    writer.append("g1", samples(4, 1, 4))
    monkeypatch.setattr("daq.store.stream_writer.to_parquet", refuse)
    with refused("output.not_writable", "No space left on device"):
        sync(writer)
    monkeypatch.undo()
    writer.close("failed", "disk full", {})
    assert verify(writer.path) == []
    assert len(read_run(writer.path).streams["g1"]["sequence"]) == 8


def test_start_on_a_full_disk_leaves_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "pwrite", lambda *arguments: refuse(arguments))
    with refused("output.not_writable", "No space left on device"):
        record(tmp_path)
    assert list(tmp_path.iterdir()) == []


def refuse(table: object) -> bytes:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


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
    with no_descriptor(), refused("run.damaged"):
        recover(left)
