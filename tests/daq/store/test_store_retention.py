import os
import shutil
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from analysis.cli import app
from daq import clock
from daq.service.maintenance import RunRetention
from daq.store import durable, mark_exported, mark_kept, survey, verify
from daq.store.marks import MARKS, Export, RunMarks, load_marks
from daq.store.retention import RunInfo, decide, delete, look
from rigs.errors import CellError
from rigs.schema.declared_tests import Retention
from tests.support.command_line import ran
from tests.support.refusals import refused
from tests.support.store_cases import finished, record

DAY_S = 86400.0
NOW_S = 1000 * DAY_S
LIMITS = Retention(days=90, gigabytes=1)


def _exported(runs: Path) -> Path:
    path = finished(runs)
    mark_exported(path, "mcap", Path("copy.mcap"))
    return path


def test_marks_do_not_affect_manifest_and_verify(run):
    before = (run / "manifest.json").read_bytes()
    assert load_marks(run) == RunMarks()
    mark_exported(run, "csv", Path("/elsewhere/table.csv"))
    mark_kept(run, True)
    mark_exported(run, "mcap", Path("/elsewhere/raw.mcap"))
    marks = load_marks(run)
    assert marks.kept and [export.file for export in marks.exports] == ["/elsewhere/table.csv", "/elsewhere/raw.mcap"]
    mark_kept(run, False)
    assert not load_marks(run).kept and len(load_marks(run).exports) == 2
    assert (run / "manifest.json").read_bytes() == before and verify(run) == []


def test_a_copy_whose_name_is_no_utf8_is_marked(run):
    mark_exported(run, "csv", Path(os.fsdecode(b"/elsewhere/k\xf6ln.csv")))
    assert [export.file for export in load_marks(run).exports] == ["/elsewhere/k\\udcf6ln.csv"]


def test_damaged_marks_are_reported_and_the_run_stays(run):
    mark_exported(run, "csv", Path("a.csv"))
    (run / MARKS).write_text('{"kept": "perhaps"}')
    assert ["marks.json" in problem for problem in verify(run)] == [True]
    assert look(run).status == "damaged" and not look(run).may_go and not delete(run)
    with refused("run.damaged", "valid boolean, unable to interpret input"):
        mark_kept(run, True)


def test_unmarkable_run_is_reported(run, tmp_path, monkeypatch):
    with refused("run.missing", "no such file or directory"):
        mark_kept(tmp_path / "nothing", True)
    writer = record(tmp_path / "open")
    with refused("run.in_use", "is being recorded"):
        mark_exported(writer.path, "csv", Path("a.csv"))

    def refuse(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(durable, "replace", refuse)
    with refused("output.not_writable", "Permission denied"):
        mark_kept(run, True)
    output = tmp_path / "raw.mcap"
    done = ran("export", run, "--to", "mcap", "-o", output)
    assert done.returncode == 0 and output.exists()  # the export itself is good
    assert "not delete" in done.stderr


def test_run_counts_as_exported_once_its_copy_is_synced(run, monkeypatch):
    """Else rigd deletes a run of which a power cut takes the copy."""
    output, synced = run.parent.parent / "raw.mcap", []

    def refuse(fd: int) -> None:
        synced.append(os.fstat(fd).st_ino)
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(durable, "sync", refuse)
    done = CliRunner().invoke(app, ["export", str(run), "--to", "mcap", "-o", str(output)])
    assert synced == [output.stat().st_ino] and not load_marks(run).exports
    assert isinstance(done.exception, CellError) and "not marked" in str(done.exception)


def test_an_export_marks_its_run_and_the_list_shows_it(run):
    done = ran("export", run, "--to", "mcap", "-o", run.parent.parent / "raw.mcap")
    assert done.returncode == 0 and done.stderr == ""
    assert [(export.format, Path(export.file).name) for export in load_marks(run).exports] == [("mcap", "raw.mcap")]
    assert ran("keep", run).stdout == f"{run}: kept\n"
    listed = ran("runs", run.parent, COLUMNS="200").stdout
    assert (
        run.name in listed and "yaw cw" in listed and "complete" in listed and " kept" in listed and "1 run " in listed
    )
    narrow = ran("runs", run.parent, COLUMNS="30").stdout
    assert str(run) in narrow and len(narrow.splitlines()) == 3  # a directory in pieces cannot be copied
    assert ran("keep", "--not", run).stdout.startswith(f"{run}: ")
    assert '"kept": false' in ran("runs", run.parent, "--json").stdout


# --- What may go ---


def test_only_a_whole_exported_run_that_is_not_kept_may_go(tmp_path):
    runs = tmp_path / "runs"
    plain, exported, kept = finished(runs), _exported(runs), _exported(runs)
    mark_kept(kept, True)
    writer = record(runs)
    crashed = Path(shutil.copytree(writer.path, runs / "crashed"))
    torn = _exported(runs)
    (torn / "manifest.json").write_text("{")
    lost = _exported(runs)
    (lost / "manifest.json").unlink()
    unrecovered = _exported(runs)
    (unrecovered / "g1-0001.arrow").write_bytes(b"")
    (runs / "notes").mkdir()
    (runs / "notes" / "read me.txt").write_text("no run")
    (runs / "link").symlink_to(exported)
    found = {info.path: info for info in survey(runs)}
    assert set(found) == {plain, exported, kept, writer.path, crashed, torn, lost, unrecovered}
    assert [path for path, info in found.items() if info.may_go] == [exported]
    assert found[writer.path].status == "recording" and found[crashed].status == "crashed"
    assert found[torn].status == found[lost].status == "damaged" and found[unrecovered].status == "crashed"
    assert [delete(path) for path in found if path != exported] == [False] * 7
    assert all(path.exists() for path in found) and delete(exported) and not exported.exists()
    writer.close("complete", "", {})


def _info(number: int, age_days: float, size: int, exported: bool = True, kept: bool = False) -> RunInfo:
    marks = RunMarks(kept=kept, exports=(Export(at="", format="csv", file=""),) * exported)
    return RunInfo(Path(str(number)), _MANIFEST, marks, "complete", size, NOW_S - age_days * DAY_S)


@pytest.fixture(autouse=True, scope="module")
def _manifest(tmp_path_factory):
    global _MANIFEST  # noqa: PLW0603
    _MANIFEST = look(finished(tmp_path_factory.mktemp("one"))).manifest


def test_old_run_is_deleted():
    found = [_info(1, 10, 1), _info(2, 91, 1), _info(3, 400, 1), _info(4, 400, 1, exported=False)]
    assert [str(run.path) for run in decide(found, LIMITS, NOW_S).delete] == ["3", "2"]
    assert decide(found, Retention(gigabytes=1), NOW_S).delete == ()


def test_the_oldest_go_until_the_rest_fits():
    half = 500_000_000
    found = [_info(1, 1, half), _info(2, 3, half), _info(3, 2, half), _info(4, 4, half, kept=True)]
    decision = decide(found, LIMITS, NOW_S)
    assert [str(run.path) for run in decision.delete] == ["2", "3"] and decision.over == 0


runs = st.lists(st.tuples(st.floats(0, 500), st.integers(0, 10**9), st.booleans(), st.booleans()), max_size=20)


@given(runs)
def test_retention_deletes_only_allowed_and_necessary_runs(
    drawn,
):
    found = [_info(number, *one) for number, one in enumerate(drawn)]
    decision = decide(found, LIMITS, NOW_S)
    assert all(run.may_go for run in decision.delete)
    left = sum(run.size for run in found) - sum(run.size for run in decision.delete)
    assert decision.over == max(0, left - 10**9)
    young = [run for run in decision.delete if NOW_S - run.ended_s <= 90 * DAY_S]
    if young:  # the last of them was still needed
        assert left + young[-1].size > 10**9
    if decision.over:
        assert {run.path for run in found if run.may_go} == {run.path for run in decision.delete}


# --- Doing it ---


def test_deletions_are_reported_and_counted(tmp_path, caplog):
    caplog.set_level("INFO")
    runs = tmp_path / "runs"
    retention = RunRetention(runs, "cell", Retention(gigabytes=0.001))
    retention.apply()
    assert retention.state()["runs"] == 0  # no directory yet
    first, second, stays = _exported(runs), _exported(runs), finished(runs)
    (stays / "g1-0001.parquet").write_bytes(bytes(1_100_000))
    retention.apply()
    assert [path.exists() for path in (first, second, stays)] == [False, False, True]
    state = retention.state()
    assert (state["deleted"], state["runs"]) == (2, 1) and state["deleted_bytes"] > 0
    assert 100_000 < state["over_bytes"] < 200_000 and state["bytes"] - state["over_bytes"] == 1_000_000
    assert caplog.text.count("retention: deleted") == 2 and "exported to" in caplog.text
    retention.apply()
    assert caplog.text.count("allowed") == 1  # not each time


def test_exported_run_is_deleted_once_it_is_older_than_the_days(tmp_path, monkeypatch):
    path = _exported(tmp_path)
    ended_s, retention = look(path).ended_s, RunRetention(tmp_path, "cell", Retention(days=1))
    for age_days, stays in ((0.5, True), (1.5, False)):
        monkeypatch.setattr(clock, "wall_ns", lambda now_s=ended_s + age_days * DAY_S: int(now_s * 1e9))
        retention.apply()
        assert path.exists() == stays


def test_runs_of_another_rig_are_nobodys_business_here(tmp_path):
    theirs = _exported(tmp_path)
    retention = RunRetention(tmp_path, "other", Retention(days=1, gigabytes=0.001))
    (theirs / "big").write_bytes(bytes(2_000_000))
    retention.apply()
    assert theirs.exists() and retention.state()["runs"] == 0


def test_private_directory_does_not_stop_retention(tmp_path, monkeypatch):
    """As lost+found, which belongs to root: a disk of their own is what the doctor advises for the runs."""
    (tmp_path / "lost+found").mkdir()
    stat = Path.stat

    def refuse(self: Path, *, follow_symlinks: bool = True) -> os.stat_result:
        if self.parent.name == "lost+found":
            raise PermissionError(13, "Permission denied")
        return stat(self, follow_symlinks=follow_symlinks)

    path = _exported(tmp_path)
    monkeypatch.setattr(Path, "stat", refuse)
    assert [run.path for run in survey(tmp_path)] == [path]
    (path / "big").write_bytes(bytes(2_000_000))
    RunRetention(tmp_path, "cell", Retention(gigabytes=0.001)).apply()
    assert not path.exists()


def test_vanishing_file_hides_no_run(tmp_path, monkeypatch):
    path, listed = finished(tmp_path), Path.iterdir
    before = look(path).size
    monkeypatch.setattr(Path, "iterdir", lambda self: iter([*listed(self), self / "manifest.json.tmp"]))
    assert look(path).size == before


def test_a_deletion_that_was_cut_off_leaves_no_half_run(tmp_path, monkeypatch):
    path = _exported(tmp_path)

    def killed(gone: Path) -> None:
        (gone / "manifest.json").unlink()
        raise OSError(5, "cut off")

    with monkeypatch.context() as patch:
        patch.setattr(shutil, "rmtree", killed)
        with pytest.raises(OSError, match="cut off"):
            delete(path)
    assert not path.exists() and list(survey(tmp_path)) == [] and len(list(tmp_path.iterdir())) == 1
    RunRetention(tmp_path, "cell", Retention(days=1)).apply()
    assert list(tmp_path.iterdir()) == []


def test_a_run_that_cannot_be_deleted_stops_no_other(tmp_path, monkeypatch):
    stuck, other = _exported(tmp_path), _exported(tmp_path)
    rename = Path.rename

    def refuse(self: Path, target: Path) -> Path:
        if self == stuck:
            raise PermissionError(13, "Permission denied")
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", refuse)
    retention = RunRetention(tmp_path, "cell", Retention(gigabytes=0.001))
    (stuck / "big").write_bytes(bytes(2_000_000))
    retention.apply()
    assert stuck.exists() and not other.exists() and retention.deleted == 1
