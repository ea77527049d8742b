import errno
import os
import shutil
import threading
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import daq.acquisition.stream_buffer
import daq.recording.active_run
import daq.recording.io_worker
import daq.recording.machine
import daq.recording.recorder
import daq.recording.warnings
from daq import clock
from daq.acquisition.stream_buffer import StreamBuffer
from daq.protocol.conversation import Sample
from daq.recording.active_run import RunLabel
from daq.recording.machine import RecordingRequest, Waiting
from daq.recording.recorder import Recorder
from daq.store import RunWriter, durable, load_manifest, read_run, recover, verify
from rigs.errors import CellError
from rigs.schema.vocabulary import TestName
from tests.support.failing_disk import COLUMNS, failing
from tests.support.recorders import recorder_of
from tests.support.refusals import refused


def _request(name: str, test: TestName = "yaw") -> RecordingRequest:
    return RecordingRequest(RunLabel(name=name, test=test, direction="cw" if test == "yaw" else None))


NEXT = _request("next")


class Written:
    """A recorder without its thread: a round when a test says so, and readers that deliver numbers."""

    def __init__(self, folder: Path) -> None:
        self.runs = folder / "runs"
        self.buffers = {name: StreamBuffer(name, columns) for name, columns in COLUMNS.items()}
        self.recorder = recorder_of(self.runs, self.buffers)
        self.delivered = 0
        self.deliver()
        self.path = self.recorder.start_run(_request("lap")).result()
        self.delivered = 0

    def deliver(self, count: int = 10) -> None:
        now = clock.now_ns()
        for buffer in self.buffers.values():
            buffer.deliver([Sample((float(self.delivered + i),), now, now, now, 8) for i in range(count)])
        self.delivered += count

    def rounds(self, count: int) -> None:
        """Rounds with readings, without waiting for the disk."""
        for _ in range(count):
            self.deliver()
            self.recorder._round()

    def round(self, count: int = 10) -> dict[str, Any]:
        self.deliver(count)
        for _ in range(4):  # of a sync and of the closing of a chunk: begun, and what became of it
            # private _round, _io, _thread, _creator: the test takes the place of the recorder, waits for the disk
            self.recorder._round()
            self.recorder._io._thread.submit(lambda: None).result()
            self.begun()
        return self.recorder.state()

    @property
    def writer(self) -> RunWriter:
        # private _current, _writers: the writer of the run whose disk fails
        current = self.recorder._current
        assert current.writer
        return current.writer

    def retry(self) -> None:
        """Let the next round try another run, without the pause."""
        # private _state: the pause until another run is tried is over at once
        state = self.recorder._state
        assert isinstance(state.phase, Waiting)
        self.recorder._state = replace(state, phase=replace(state.phase, due_s=0.0))

    def begun(self) -> None:
        self.recorder._io._creator.submit(lambda: None).result()

    def stop(self) -> Any:
        return self.recorder.stop_run().result()

    def start(self, recording: RecordingRequest) -> Future[Path]:
        """Start a run after new readings, which are not in it: on a slow computer the last ones could be too old."""
        delivered = self.delivered
        self.deliver()
        self.delivered = delivered
        return self.recorder.start_run(recording)

    def until_it_goes_on(self) -> None:
        while self.round()["recording"] is None:
            pass
        self.round()
        self.stop()

    def accounted(self) -> list[Path]:
        """Both runs. Each reading must be in exactly one of them, or counted as dropped."""
        former, follower = sorted(self.runs.iterdir(), key=lambda path: bool(load_manifest(path).follows))
        assert load_manifest(follower).follows == former.name and load_manifest(follower).name == "lap"
        missed = {}
        for name, (column,) in COLUMNS.items():
            counters = load_manifest(follower).counters[name]
            missed[name] = counters.get("dropped", 0)
            read = [read_run(path).streams[name][column].astype(int).tolist() for path in (former, follower)]
            assert read[0] == list(range(len(read[0])))
            assert read[1] == list(range(len(read[0]) + missed[name], self.delivered))
            assert load_manifest(former).counters[name]["samples"] == len(read[0])
        assert verify(former) == verify(follower) == []
        told = {(row["stream"], row["kind"]) for row in read_run(follower).faults}
        assert told == {(name, "dropped") for name, count in missed.items() if count}
        return [former, follower]


@pytest.fixture
def written(tmp_path, monkeypatch):
    monkeypatch.setattr(daq.recording.machine, "FIRST_PAUSE_S", 0.02)
    # private _SYNC_S, _INTERVAL_S, _SLOW_S, _ROOM: the real limits take seconds and thousands of readings
    monkeypatch.setattr(daq.recording.io_worker, "_SYNC_S", 0.0)
    monkeypatch.setattr(daq.recording.warnings, "_INTERVAL_S", 0.0)
    return Written(tmp_path)


def test_a_disk_nearly_full_ends_the_run_whole_and_another_follows(written, monkeypatch, caplog):
    written.round()
    monkeypatch.setattr(durable, "free_bytes", lambda _: 3_000_000)
    state = written.round()
    assert state["recording"] is None and state["waiting"] == "lap" and not any(state["missed"].values())
    assert state["last_end"].startswith("interrupted: ")
    assert len(read_run(written.path).streams["robot"]["q1_deg"]) == 20  # whole, the last readings too
    assert written.round()["missed"] == {"g1": 10, "g2": 10, "robot": 10}
    monkeypatch.setattr(durable, "free_bytes", lambda _: 30_000_000)
    written.retry()
    assert written.round()["recording"] is None  # more room is needed to begin than to go on
    monkeypatch.undo()
    written.until_it_goes_on()
    written.accounted()
    for told in (
        "3.0 MB free, 16.8 MB needed",
        "30.0 MB free, 67.1 MB needed",
        f"after {written.path.name}",
    ):
        assert told in caplog.text


@pytest.mark.parametrize(
    ("number", "calls"),
    [
        (errno.EIO, ("fsync",)),
        (errno.EIO, ("open", "pwrite", "fsync", "replace", "unlink", "ftruncate", "statvfs")),
        (errno.EROFS, ("open", "pwrite", "replace", "unlink", "mkdir")),
        (errno.ENOSPC, ("pwrite",)),
    ],
    ids=["fsync", "gone", "read-only", "quota"],
)
def test_failing_disk_ends_the_run_and_another_follows(written, number, calls, caplog):
    written.round()
    with failing(number, *calls):
        state = written.round()
        assert state["recording"] is None and os.strerror(number) in str(state["last_end"])
        written.retry()
        assert written.round()["waiting"] == "lap"
        with pytest.raises(CellError):
            RunWriter.create(written.runs, load_manifest(written.path))
    written.until_it_goes_on()
    former, _ = written.accounted()
    assert load_manifest(former).exit_status in ("failed", "recovered")
    assert "recording: waits: " in caplog.text and "samples missed: 10 of g1" in caplog.text


@pytest.mark.parametrize("resumed", [True, False])
def test_dropped_samples_are_counted_despite_a_failing_disk(written, monkeypatch, resumed):
    """A chunk vanishes, and the run that follows is lost before its first write, with the count that it was to hold."""
    monkeypatch.setattr(daq.recording.machine, "FIRST_PAUSE_S", 1e9)
    written.round()
    (written.path / "g1-0001.arrow").unlink()
    written.round()
    written.round()  # its readings are missed
    written.retry()
    written.recorder._round()
    written.begun()
    with failing(errno.EIO, "pwrite", "fsync", "mkdir"):
        if resumed:
            written.round()
        else:
            with pytest.raises(CellError):
                written.stop()
    if resumed:
        written.retry()
        written.until_it_goes_on()
    runs = list(written.runs.iterdir())
    for path in runs:
        recover(path)
        assert verify(path) == []
    for name in COLUMNS:
        counters = [load_manifest(path).counters.get(name, {}) for path in runs]
        counted = sum(count.get("samples", 0) + count.get("dropped", 0) for count in counters)
        assert counted + written.recorder.losses.counts[name] == written.delivered
        assert bool(written.recorder.losses.counts[name]) is not resumed


def test_loss_without_a_following_run_is_logged_and_in_the_status(written, caplog):
    written.round()
    written.deliver(7)
    with failing(errno.EIO, "pwrite", "fsync"), refused("recording.failed", "free some space or repair the"):
        written.stop()
    assert written.recorder.losses.counts == dict.fromkeys(COLUMNS, 7)
    assert written.buffers["g1"].state().counters["dropped"] == 7
    assert "g1: dropped: 7 samples" in caplog.text
    recover(written.path)
    assert len(read_run(written.path).streams["g1"]["g1_mm"]) == 10  # the rest is there


def test_loss_is_counted_if_the_run_closes_after_it_was_abandoned(written):
    """Its disk is back by then: the run closes without an error, and without what could not be written."""
    closing, disk = threading.Event(), written.recorder._io._thread
    written.round()
    with failing(errno.EIO, "pwrite", "fsync"):
        disk.submit(closing.wait)
        written.rounds(1)
        with refused("recording.none", "disk and was abandoned, samples missed"):
            written.recorder.stop_run()
    closing.set()
    disk.submit(lambda: None).result()
    assert len(read_run(written.path).streams["g1"]["g1_mm"]) == 10
    assert written.recorder.losses.counts == dict.fromkeys(COLUMNS, 10)


def test_unmounted_disk_gets_nothing_below_its_mount_point(written):
    written.round()
    with failing(errno.EIO, "pwrite"):
        written.round()
    away = written.runs.rename(written.runs.with_name("away"))
    written.retry()
    assert written.round()["waiting"] == "lap"
    assert not written.runs.exists()
    away.rename(written.runs)
    written.until_it_goes_on()
    written.accounted()


def test_deleted_run_is_followed_by_another_and_counts_as_dropped(written, monkeypatch, caplog):
    """Its disk is there all the time, so nothing has to be mounted and nothing waited for."""
    monkeypatch.setattr(daq.recording.machine, "FIRST_PAUSE_S", 1e9)
    written.round()
    shutil.rmtree(written.path)
    written.round()
    written.until_it_goes_on()
    assert "was removed" in caplog.text
    assert not any(word in caplog.text for word in ("make room", "rig recover", "no such"))
    (follower,) = written.runs.iterdir()
    read, counters = read_run(follower).streams["g1"]["g1_mm"], load_manifest(follower).counters["g1"]
    assert read.tolist() == list(range(counters["dropped"], written.delivered)) and counters["dropped"] >= 20
    assert verify(follower) == []


@pytest.mark.parametrize(
    ("end", "code"),
    [
        (Recorder.stop_run, "recording.none"),
        (lambda recorder: recorder.start_run(_request("b")).result(), "disk.full"),
    ],
)
def test_stop_or_start_ends_the_waiting(written, end, code, monkeypatch, caplog):
    monkeypatch.setattr(durable, "free_bytes", lambda _: 0)
    written.round()
    written.round(7)
    with refused(code):
        end(written.recorder)
    assert "was abandoned, samples missed: 7 of g1, 7 of g2, 7 of robot" in caplog.text
    monkeypatch.undo()
    assert written.round()["waiting"] is None


def test_a_slow_sync_keeps_nothing_from_the_disk(written, gate, monkeypatch, caplog):
    monkeypatch.setattr(daq.recording.warnings, "_SLOW_S", 0.0)
    monkeypatch.setattr(os, "fsync", gate.before())
    written.rounds(1)
    assert gate.reached.wait(60)
    written.rounds(8)  # each would wait for ever, were it to wait for the disk
    state = written.recorder.state()
    assert (state["samples"]["g1"], state["synced"]["g1"]) == (90, 0)
    assert written.writer.stored()["g1"] == 90  # with the system, where a kill does not reach it
    gate.open()
    written.round(0)
    written.stop()
    assert load_manifest(written.path).counters["g1"] == {"samples": 90}
    assert "disk: slow sync: has taken" in caplog.text


def test_run_kept_open_by_a_program_error_is_reported(written, monkeypatch, caplog):
    monkeypatch.setattr(RunWriter, "close", lambda *_: 1 / 0)
    written.recorder.stop_run()
    written.recorder._io.shut_down()
    assert f"{written.path}: not closed" in caplog.text and "ZeroDivisionError" in caplog.text
    assert str(written.recorder.state()["last_end"]).startswith("failed")


def test_hanging_sync_bounds_memory_and_counts_the_rest(written, gate, monkeypatch):
    """At the end of a chunk, when the next one waits for the disk to have all of it."""
    monkeypatch.setattr("daq.store.writer.CHUNK_AGE_NS", 0)
    monkeypatch.setattr("daq.store.writer.MOST_PENDING", 30)
    monkeypatch.setattr(daq.acquisition.stream_buffer, "_ROOM", 40)
    monkeypatch.setattr(os, "fsync", gate.before())
    written.rounds(12)
    assert gate.reached.wait(60)
    assert len(written.writer._writers["g1"].pending) == 30
    assert written.buffers["g1"].state().waiting == 40
    gate.open()
    ended = written.stop()
    assert ended.counters["g1"] == {"samples": 80, "dropped": 40}
    assert load_manifest(written.path).counters["g1"] == {"samples": 80, "dropped": 40} and verify(written.path) == []


@pytest.fixture
def stalled(gate, monkeypatch):
    """A disk that takes no Parquet file before the gate is open."""
    write = durable.replace
    held = gate.before(write)
    monkeypatch.setattr(
        durable, "replace", lambda path, data: (held if path.suffix == ".parquet" else write)(path, data)
    )
    return gate


def test_closing_a_chunk_keeps_nothing_from_the_disk(written, monkeypatch, stalled):
    monkeypatch.setattr("daq.store.writer.CHUNK_AGE_NS", 0)
    while not stalled.reached.is_set():
        written.rounds(1)
    written.rounds(4)  # each would wait for ever, were it to wait for the disk
    assert written.writer.stored()["g1"] == written.delivered  # with the system, where no kill reaches it
    stalled.open()
    written.round()
    written.stop()
    assert len([chunk for chunk in load_manifest(written.path).chunks if chunk.stream == "g1"]) > 1
    assert verify(written.path) == []
    assert read_run(written.path).streams["g1"]["g1_mm"].tolist() == list(range(written.delivered))


def test_slow_close_delays_neither_watchdog_nor_next_run(written, stalled):
    written.round()
    closing = written.recorder.stop_run()
    assert stalled.reached.wait(60)
    written.rounds(1)
    follower = written.start(NEXT).result()
    written.rounds(1)
    assert not closing.done() and written.recorder.state()["recording"] == "next"
    stalled.open()
    assert closing.result().counters["g1"] == {"samples": 10}
    assert written.stop().path == follower
    assert verify(written.path) == verify(follower) == []


def test_a_slow_write_keeps_no_reader_waiting(written, gate, monkeypatch, caplog):
    monkeypatch.setattr(daq.acquisition.stream_buffer, "_ROOM", 50)
    monkeypatch.setattr(daq.recording.warnings, "_SLOW_S", 0.0)
    monkeypatch.setattr(os, "pwrite", gate.before(os.pwrite))
    writing = threading.Thread(target=written.round)
    writing.start()
    assert gate.reached.wait(60)
    for _ in range(8):  # each would wait for ever, were it to wait for the disk
        written.deliver()
    assert written.recorder.state()["recording"] == "lap"
    assert written.buffers["g1"].state().counters == {"samples": 100, "dropped": 30}
    gate.open()
    writing.join(60)
    written.round(0)
    written.stop()
    assert load_manifest(written.path).counters["g1"] == {"samples": 60, "dropped": 30}
    assert read_run(written.path).streams["g1"]["g1_mm"].tolist() == list(range(60))
    assert "disk: slow write: has taken" in caplog.text


@pytest.mark.parametrize("stopped", [False, True], ids=["goes on", "stopped meanwhile"])
def test_slowly_created_run_contains_all_samples_since(written, making, stopped):
    written.stop()
    written.delivered = 0
    beginning = written.start(NEXT)
    assert making.reached.wait(60)
    written.rounds(4)  # each would wait for ever, were it to wait for the disk
    state = written.recorder.state()
    assert (state["beginning"], state["waiting"], state["recording"]) == ("next", None, None)
    with refused("recording.running", "already running"):
        written.recorder.start_run(_request("other"))
    ending = written.recorder.stop_run("interrupted", "enough") if stopped else None
    assert written.recorder.state().get("closing", False) == stopped
    making.open()
    path = beginning.result()
    written.deliver()
    ended = (ending or written.recorder.stop_run()).result()
    count = 40 if stopped else 50
    assert ended.path == path and ended.counters["g1"] == {"samples": count} and verify(path) == []
    assert read_run(path).streams["robot"]["q1_deg"].tolist() == list(range(count))
    assert ("enough" in load_manifest(path).reason) == stopped


def test_samples_during_the_start_of_a_run_are_bounded(written, making, monkeypatch):
    monkeypatch.setattr("daq.recording.active_run.MOST_PENDING", 30)
    monkeypatch.setattr(daq.acquisition.stream_buffer, "_ROOM", 40)
    written.stop()
    beginning = written.start(NEXT)
    assert making.reached.wait(60)
    written.rounds(12)
    making.open()
    beginning.result()
    assert written.stop().counters["g1"] == {"samples": 70, "dropped": 50}


def test_slow_recovery_of_a_former_run_delays_nothing(written, gate, monkeypatch):
    reviving = daq.recording.active_run
    monkeypatch.setattr(reviving, "recover_and_log", gate.before(reviving.recover_and_log))
    written.round()
    with failing(errno.EIO, "fsync"):
        written.round()
    written.retry()
    while not gate.reached.is_set():
        written.rounds(1)
    written.rounds(4)  # each would wait for ever, were it to wait for the disk
    assert written.recorder.state()["waiting"] == "lap"
    gate.open()
    written.until_it_goes_on()
    written.accounted()


def test_stop_during_a_refused_start_ends_the_waiting(written, gate, monkeypatch, caplog):
    def refuse(path: Path) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    written.round()
    with failing(errno.EIO, "fsync"):
        written.round()
    monkeypatch.setattr(durable, "make_directory", gate.before(refuse))
    written.retry()
    while not gate.reached.is_set():
        written.recorder._round()
    written.deliver(7)
    written.recorder._round()
    ending = written.recorder.stop_run()
    gate.open()
    with refused("output.not_writable", "cannot be written"):
        ending.result()
    written.begun()
    assert written.recorder.state()["waiting"] is None
    assert "was abandoned, samples missed: 7 of g1, 7 of g2, 7 of robot" in caplog.text


def test_disk_without_runs_gets_no_further_request(written, making):
    written.stop()
    ending = []
    for _ in range(2):
        written.deliver()
        written.start(NEXT)
        ending.append(written.recorder.stop_run())
    written.deliver()
    with refused("daemon.busy", "runs, which were stopped early"):
        written.start(NEXT)
    making.open()
    assert len({end.result().path for end in ending}) == 2
    written.begun()
    written.start(NEXT).result()
    written.stop()


def test_program_error_during_the_start_of_a_run_ends_the_daemon(written, monkeypatch):
    written.stop()
    written.deliver()
    ended: list[type[BaseException]] = []
    monkeypatch.setattr(threading, "excepthook", lambda args: ended.append(args.exc_type))
    monkeypatch.setattr(daq.recording.active_run.PlausibilityCheck, "check", lambda *_: 1 / 0)
    beginning = written.start(NEXT)
    with pytest.raises(ZeroDivisionError):
        beginning.result(20)
    written.recorder._io.shut_down()
    assert ended == [ZeroDivisionError] and written.recorder.state()["beginning"] is None
