import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from daq.protocol.conversation import Sample
from daq.store import RunWriter, durable, load_manifest, new_manifest, read_run, verify
from daq.store.startup_recovery import StartupRecovery
from tests.support.bench import Bench
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
    StartupRecovery(tmp_path).run()
    assert load_manifest(writer.path).exit_status == "recording"  # a run that another daemon writes is no crash
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
