import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from daq.protocol.conversation import Sample
from daq.store import RunWriter, durable, load_manifest, new_manifest, read_run, verify
from daq.store.run_directory import MARGIN_BYTES, TO_BEGIN_BYTES
from daq.store.startup_recovery import StartupRecovery
from tests.support.bench import PATIENCE_S, Bench, rig_text
from tests.support.store_cases import write_and_sync

WHO: dict[str, Any] = {"rig_name": "r", "rig_text": "", "operator": "", "streams": {"g1": ("g1_mm",)}}


def _revived(bench: Bench, path: Path) -> None:
    bench.until(lambda _: load_manifest(path).exit_status == "recovered")
    assert verify(path) == []
    assert len(read_run(path).streams["robot"]["q1_deg"]) > 20


def test_next_start_recovers_a_killed_recording(bench):
    bench.start().all_reading()
    path = bench.record()
    bench.until(lambda state: min(state["synced"].values()) > 20)
    synced = bench.status()["synced"]
    bench.signalled(signal.SIGKILL)
    bench.start()
    _revived(bench, path)
    kept = read_run(path).streams
    assert all(len(kept[stream]["sequence"]) >= rows for stream, rows in synced.items())
    _, said = bench.signalled(signal.SIGTERM)
    assert f"recovered {path}, " in said


def test_two_daemons_share_a_runs_directory(bench, tmp_path):
    (tmp_path / "runs").mkdir()
    (tmp_path / "second").mkdir()
    (tmp_path / "second" / "runs").symlink_to(tmp_path / "runs")
    bench.start().all_reading()
    first = bench.record("same-name")
    with Bench(tmp_path / "second", rig_text().replace("name: bench", "name: other")) as other:
        other.socket = other.socket.with_name("other.sock")
        other.start().all_reading()
        second = other.record("same-name")
        bench.recorded(100)
        other.recorded(100)
        assert load_manifest(first).exit_status == "recording"  # a run that another daemon writes is no crash
        bench.signalled(signal.SIGKILL)
        bench.start()
        _revived(bench, first)
        assert load_manifest(second).exit_status == "recording"
        assert "being recorded" in other.fails("rig", "recover", second, code=3)
        assert other.run("rig", "record", "stop").returncode == 0
        for daemon in (bench, other):
            assert "not recovered" not in daemon.signalled(signal.SIGTERM)[1]
    assert first.resolve() != second.resolve()
    assert (load_manifest(second).exit_status, load_manifest(second).rig_name) == ("complete", "other")
    assert verify(second) == []


def test_unusual_directories_are_kept_and_reported(tmp_path, caplog):
    for name, file, data in (("empty", ".lock", b""), ("other", "notes.txt", b"x"), ("newer", "manifest.json", b"{}")):
        (tmp_path / name).mkdir()
        (tmp_path / name / file).write_bytes(data)
    (tmp_path / "file").touch()
    before = sorted(tmp_path.rglob("*"))
    StartupRecovery(tmp_path).run()
    StartupRecovery(tmp_path / "none").run()
    assert sorted(tmp_path.rglob("*")) == before
    (told,) = caplog.messages
    assert "not recovered: " in told and "newer" in told and "a different version" in told


def test_unreadable_directory_does_not_stop_recovery(tmp_path, monkeypatch):
    """As lost+found, which belongs to root, on a disk that the runs have to themselves."""
    (tmp_path / "lost+found").mkdir()
    writer = RunWriter.create(tmp_path, new_manifest(name="lap", test="radial", direction=None, **WHO))
    writer.append("g1", [Sample((0.5,), 1, 2, 3, 8)])
    write_and_sync(writer)
    # private _writers, _lock: files and lock are given up as the system does it when a process is killed
    for stream_writer in writer._writers.values():
        stream_writer.release()
    durable.close(writer._lock)  # as the system does when it is killed
    iterdir = Path.iterdir

    def refuse(self: Path) -> Iterator[Path]:
        if self.name == "lost+found":
            raise PermissionError(13, "Permission denied")
        return iterdir(self)

    monkeypatch.setattr(Path, "iterdir", refuse)
    StartupRecovery(tmp_path).run()
    assert load_manifest(writer.path).exit_status == "recovered"


SMALL_DISK = 'mount -t tmpfs -o size="$0" tmpfs runs && exec "$@"'
IMPATIENT = """
import daq.recording.machine
daq.recording.machine.FIRST_PAUSE_S = daq.recording.machine.LONGEST_PAUSE_S = 0.2
from daq.service.rigd import main
main()
"""


def test_a_small_real_disk_fills_up_and_is_cleared(bench):
    unshare = ["unshare", "--mount", "--map-root-user", "sh", "-c", SMALL_DISK]
    size = TO_BEGIN_BYTES + 2 * MARGIN_BYTES
    (bench.folder / "runs").mkdir()
    if shutil.which("unshare") is None:
        pytest.skip("no unshare")
    probe = subprocess.run([*unshare, str(size), "true"], cwd=bench.folder, capture_output=True, check=False)
    if probe.returncode:
        pytest.skip(f"no mount: {probe.stderr.decode().strip()}")
    bench.start(program=[*unshare, str(size), sys.executable, "-c", IMPATIENT]).all_reading()
    inside = Path(f"/proc/{bench.daemon.pid}/root")
    if not os.access(inside / str(bench.folder)[1:], os.W_OK):
        pytest.skip("not reachable")
    first = inside / str(bench.record())[1:]
    bench.recorded(20)
    ballast = first.parent / "ballast"
    _fill(ballast, size - MARGIN_BYTES)
    state = bench.until(lambda state: state.get("waiting"))
    assert state["last_end"].startswith("interrupted: ")
    assert "samples missed: " in " ".join(bench.run("rig", "status").stdout.split())
    bench.until(lambda state: min(state["missed"].values(), default=0) > 5)
    ballast.unlink()
    bench.until(lambda state: state["recording"])
    bench.recorded(20)
    follower = inside / str(bench.status()["run"])[1:]
    assert bench.run("rig", "record", "stop").returncode == 0
    assert verify(first) == verify(follower) == []
    assert load_manifest(first).exit_status == "interrupted" and load_manifest(follower).follows == first.name
    dropped = {row["stream"]: row["count"] for row in read_run(follower).faults if row["kind"] == "dropped"}
    assert dropped.keys() == {"g1", "g2", "robot"}
    robot = [read_run(path).streams["robot"]["device_time_s"] for path in (first, follower)]
    missed = round((robot[1][0] - robot[0][-1]) * 500) - 1
    assert dropped["robot"] == missed  # by the controller's own clock
    bench.daemon.send_signal(signal.SIGTERM)
    assert bench.daemon.wait(PATIENCE_S) == 0


def _fill(path: Path, size: int) -> None:
    with path.open("wb") as file:
        os.posix_fallocate(file.fileno(), 0, size)
