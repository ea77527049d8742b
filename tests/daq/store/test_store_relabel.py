import errno
import json
from pathlib import Path

import pyarrow as pa

from analysis import save_run
from analysis.runs.loading import load_measured
from daq.store import durable, judge, load_manifest, read_run, recover, relabel, survey, table_run, write_table_run
from daq.store.ledger import LEDGER
from daq.store.manifest import MANIFEST
from rigs.load import load
from tests.support.command_line import ran
from tests.support.refusals import refused
from tests.support.store_cases import crash, record
from tests.support.written_runs import write_simulated


def _files(run: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in run.iterdir() if file.name not in (LEDGER, durable.LOCK)}


def test_the_new_words_hold_and_the_old_ones_are_kept(run):
    before, files = load_manifest(run), _files(run)
    relabel(run, direction="acw")
    relabel(run, test="roll", operator="bob")
    after = load_manifest(run)
    assert (after.test, after.direction, after.operator) == ("roll", "acw", "bob")
    history = [(change.field, change.old, change.new) for change in after.relabelled]
    assert history == [("direction", "cw", "acw"), ("test", "yaw", "roll"), ("operator", "ada", "bob")]
    assert all(change.at >= before.started for change in after.relabelled)
    unchanged = {"relabelled", "test", "direction", "operator"}
    assert after.model_dump(exclude=unchanged) == before.model_dump(exclude=unchanged)
    assert _files(run) == files and judge(run).summary.endswith(": whole") and recover(run).nothing_to_do
    (listed,) = survey(run.parent)
    assert listed.manifest == after and read_run(run).manifest == after


def test_a_manifest_without_a_history_reads_and_is_written_as_before(run):
    before = (run / MANIFEST).read_bytes() + (run / LEDGER).read_bytes()
    assert b"relabelled" not in before
    relabel(run, direction="cw", operator="ada")
    assert (run / MANIFEST).read_bytes() + (run / LEDGER).read_bytes() == before  # these are the words that it has


def test_a_run_that_is_no_circle_any_more_has_no_direction(run):
    assert relabel(run, test="radial").direction is None
    with refused("answer.missing", "test needs a direction, which this"):
        relabel(run, test="yaw")
    assert relabel(run, test="yaw", direction="acw").direction == "acw"
    assert len(load_manifest(run).relabelled) == 4


def test_invalid_label_is_refused_and_changes_nothing(run):
    before = (run / MANIFEST).read_bytes()
    with refused("usage", "test does not have a direction"):
        relabel(run, test="radial", direction="acw")
    with refused("readings.unsuitable", "yaw test, which cannot be relabelled"):
        relabel(run, test="pose")
    for name in ("a\nb", "a\x1b[2Jb", "a\tb"):
        with refused("usage", "contains control characters"):
            relabel(run, operator=name)
    with refused("usage", "the name has"):
        relabel(run, operator="x" * 201)
    with refused("usage", "placement String should match pattern"):
        relabel(run, placement="a place")
    assert (run / MANIFEST).read_bytes() == before


def test_a_run_being_recorded_or_not_closed_is_refused(tmp_path):
    writer = record(tmp_path)
    with refused("run.in_use", "is being recorded"):
        relabel(writer.path, direction="acw")
    path = crash(writer)
    with refused("run.in_use", "the recording crashed"):
        relabel(path, direction="acw")
    recover(path)
    assert relabel(path, direction="acw").exit_status == "recovered"


def test_a_table_is_relabelled_only_as_far_as_its_rows_allow(tmp_path):
    columns = pa.table({"t_s": [0.0], "direction": ["cw"]})
    who = {"rig_name": "r", "rig_text": "", "operator": "", "source": "s.csv", "source_sha256": "0"}
    run = table_run(tmp_path / "lap", columns, test="yaw", direction="cw", **who)
    write_table_run(run, run.path)
    assert relabel(tmp_path / "lap", test="roll").test == "roll"
    with refused("readings.unsuitable", "an imported table with the direction"):
        relabel(tmp_path / "lap", direction="acw")
    with refused("readings.unsuitable", "roll test, which cannot be relabelled"):
        relabel(tmp_path / "lap", test="radial")


def test_lines_that_cannot_be_verified_are_not_replaced(run):
    relabel(run, operator="anna")
    relabel(run, operator="berta")
    ledger = (run / LEDGER).read_bytes()
    damaged = ledger.replace(b"anna", b"enna", 1)
    (run / LEDGER).write_bytes(damaged)
    with refused("run.damaged", "verified, and continuing would replace them"):
        relabel(run, placement="wall")
    assert (run / LEDGER).read_bytes() == damaged
    recover(run)
    relabel(run, placement="wall")
    (kept,) = run.glob(f"{LEDGER}.torn*")
    assert kept.read_bytes() == damaged


def test_a_disk_that_refuses_leaves_the_old_label(run, monkeypatch):
    def full(fd: int, data: bytes, offset: int) -> None:
        raise OSError(errno.ENOSPC, "full")

    monkeypatch.setattr(durable, "write_at", full)
    with refused("output.not_writable", "cannot be relabelled"):
        relabel(run, direction="acw")
    monkeypatch.undo()
    assert load_manifest(run).direction == "cw"


def test_command_relabels_several_runs_and_analyse_reports_it_once(tmp_path):
    rig, text = load("paper-fanuc")
    runs = list(write_simulated(rig, text, "yaw", ("acw",), [1, 2], tmp_path))
    done = ran("relabel", *runs, "--operator", "bob", "--test", "roll")
    assert all(f"{run}: roll acw" in line for run, line in zip(runs, done.stdout.splitlines(), strict=True))
    told = [doubt for doubt in load_measured(runs[0]).doubts if "relabelled" in doubt]
    assert len(told) == 1
    assert told[0].endswith(" to bob")
    relabel(runs[0], operator="rig simulate", test="yaw")
    assert not any("relabelled" in doubt for doubt in load_measured(runs[0]).doubts)  # it is what it was
    relabel(runs[0], operator="bob", test="roll")
    listed = json.loads(ran("runs", tmp_path, "--json").stdout)
    assert [(one["test"], one["operator"], one["relabelled"]) for one in listed] == [("roll", "bob", True)] * 2
    assert ran("relabel", runs[0]).returncode == 2


def test_a_relabelled_table_saved_again_is_whole_and_keeps_its_history(tmp_path):
    rig, text = load("paper-fanuc")
    (run,) = write_simulated(rig, text, "yaw", ("acw",), [1], tmp_path)
    relabel(run, test="roll", operator="bob")
    again = save_run(load_measured(run), tmp_path / "again")
    assert judge(again).summary == f"{again}: whole"
    label = load_manifest(again)
    assert (label.test, label.operator, label.relabelled) == ("roll", "bob", load_manifest(run).relabelled)
