import errno
import hashlib
import json
import os
import shutil
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from analysis.cli import app
from daq.store import judge, load_manifest, read_run, recover, relabel, verify
from daq.store.ledger import Ledger, LedgerEntry, claim_in, line_of, verified
from daq.store.verify import END_UNKNOWN
from rigs.errors import CellError, FileError
from tests.support.command_line import ran
from tests.support.nightly import examples
from tests.support.refusals import refused
from tests.support.store_cases import (
    assert_holds,
    crash,
    edit_chunk,
    edit_manifest,
    fault,
    finished,
    forget_chunk,
    ledger_records,
    put_ledger,
    record,
    samples,
    start,
)

CUT = f"recovered: no rows are known to be missing {END_UNKNOWN}"
"""Verdict on a run with an unknown end."""
OLD = Path(__file__).parent / "data"
"""Runs as they were recorded before there was a ledger: version-1 of 20 rows, version-1-crashed of 12."""


@pytest.fixture
def old(tmp_path):
    return Path(shutil.copytree(OLD / "version-1", tmp_path / "old"))


def said(run: Path) -> str:
    """Return verdict and problems as reported by `rig verify`, without the directory."""
    verdict = judge(run)
    return "\n".join(line.removeprefix(str(run)).lstrip(": /") for line in (verdict.summary, *verdict.lines))


def test_line_has_the_documented_form(run):
    last, kinds = "", []
    for line in (run / "ledger.jsonl").read_text().splitlines():
        record = json.loads(line)
        last_of_line = record.pop("sha256")
        content = json.dumps(record, separators=(",", ":"), ensure_ascii=False)
        assert hashlib.sha256((last + content).encode()).hexdigest() == last_of_line
        last, kinds = last_of_line, [*kinds, *record]
    assert kinds[0] == "opening" and kinds[-1] == "seal" and set(kinds[1:-1]) == {"chunk"}
    first, *_, seal = ledger_records(run)
    assert first["opening"] == hashlib.sha256((run / "manifest.json").read_bytes()).hexdigest()
    assert seal["seal"]["rows"] == {"g1": 20, "robot": 20, "faults": 5}
    assert said(run) == "whole"


@pytest.mark.parametrize("file", ["g1-0001.parquet", "g1-0002.parquet", "g1-0003.parquet", "robot-0003.parquet"])
def test_removed_chunk_is_missed_even_with_a_repaired_chain(run, file):
    forget_chunk(run, file)
    assert said(run).startswith("not whole") and f"of {file[:-13]} are missing" in said(run)


def test_faults_that_are_gone_are_missed(run):
    forget_chunk(run, "faults-0001.parquet")
    seal = ledger_records(run)[-1]
    seal["seal"]["rows"]["faults"] = 0
    put_ledger(run, [*ledger_records(run)[:-1], seal])
    verdict, counted = said(run).splitlines()
    assert verdict == "not whole" and counted.startswith("15 garbled of g1")


def test_renumbered_chunk_is_reported(run):
    (run / "g1-0003.parquet").rename(run / "g1-0004.parquet")
    edit_chunk(run, "g1-0003.parquet", {"file": "g1-0004.parquet"})
    assert "chunk 3 of g1 is missing" in said(run)


def test_truncated_ledger_is_a_run_without_end(run):
    lines = (run / "ledger.jsonl").read_bytes().splitlines(keepends=True)
    for count in range(len(lines)):
        (run / "ledger.jsonl").write_bytes(b"".join(lines[:count]))
        assert said(run).startswith("not whole")
        with refused("run.in_use", "the recording crashed"):
            read_run(run)


@examples(20, 60)
def test_nothing_changes_in_a_ledger_unseen(whole, run, examples):
    @settings(max_examples=examples)
    @given(data=st.data())
    def holds(data: st.DataObject) -> None:
        good = (whole / "ledger.jsonl").read_bytes()
        lines = good.splitlines(keepends=True)
        one, other = (data.draw(st.integers(0, len(lines) - 1)) for _ in range(2))
        how = data.draw(st.sampled_from(["drop", "swap", "double", "flip"]))
        if how == "drop":
            del lines[one]
        elif how == "double":
            lines.insert(other, lines[one])
        elif how == "swap":
            lines[one], lines[other] = lines[other], lines[one]
        else:
            place = data.draw(st.integers(0, len(lines[one]) - 1))
            lines[one] = lines[one][:place] + bytes([lines[one][place] ^ 1]) + lines[one][place + 1 :]
        spoilt = b"".join(lines)
        (run / "ledger.jsonl").write_bytes(spoilt)
        assert (said(run) == "whole") == (spoilt == good)
        if spoilt != good:
            copy = Path(shutil.copytree(run, run.with_name("copy"), dirs_exist_ok=True))
            assert not recover(copy).nothing_to_do and recover(copy).nothing_to_do
            assert_holds(read_run(copy), 20)
            ended = claim_in(spoilt, verified(good).entries[0].opening).ended
            assert said(copy).startswith("recovered: no rows") if ended else said(copy) == CUT
            shutil.rmtree(copy)

    holds()


def without_g1(run: Path) -> list[bytes]:
    """The lines of its ledger, after the files of g1 and the lines about them are gone."""
    for file in run.glob("g1-*"):
        file.unlink()
    lines = (run / "ledger.jsonl").read_bytes().splitlines(keepends=True)
    return [line for line in lines if b'"file":"g1-' not in line]


@pytest.mark.parametrize("interrupted", [False, True])
def test_unverifiable_seal_still_counts_missing_rows(run, monkeypatch, interrupted):
    (run / "ledger.jsonl").write_bytes(b"".join(without_g1(run)))
    assert said(run).startswith("not whole")
    if interrupted:
        with monkeypatch.context() as patch, pytest.raises(CellError):
            patch.setattr(Ledger, "resume", refuse_to_open)
            recover(run)
    recover(run)
    count, missing = said(run).splitlines()
    assert count.startswith("recovered: 20 rows") and missing.startswith("rows 0 to 19 of g1 ")
    assert recover(run).nothing_to_do


def refuse_to_open(run: Path) -> None:
    raise OSError(errno.EIO, os.strerror(errno.EIO))


def test_damaged_first_line_does_not_hide_the_seal(run):
    (run / "ledger.jsonl").write_bytes(b"x" + b"".join(without_g1(run)))
    recover(run)
    assert "rows 0 to 19 of g1 are missing" in said(run)


def test_a_seal_of_another_run_claims_nothing(run, tmp_path):
    shutil.copy(finished(tmp_path / "other") / "ledger.jsonl", run / "ledger.jsonl.torn")
    (run / "ledger.jsonl").write_bytes(b"".join(without_g1(run)[:-1]))
    recover(run)
    assert said(run) == CUT


def test_missing_ledger_is_rebuilt_from_the_chunks(run):
    (run / "ledger.jsonl").unlink()
    assert "ledger.jsonl: is missing" in said(run)
    recover(run)
    assert said(run) == CUT
    assert load_manifest(run).counters == {"g1": {"samples": 20, "garbled": 15}, "robot": {"samples": 20}}


def test_changed_manifest_is_refused_and_restored_from_a_chunk(run):
    before = (run / "manifest.json").read_text()
    (run / "manifest.json").write_text(before.replace('"cw"', '"acw"'))
    with refused("run.damaged", "has changed since the start of"):
        read_run(run)
    assert said(run).startswith("not whole")
    recover(run)
    assert (run / "manifest.json").read_text() == before
    assert said(run).startswith("recovered: no rows")


def test_a_ledger_of_another_run_is_set_aside(run, tmp_path):
    shutil.copy(finished(tmp_path / "other") / "ledger.jsonl", run / "ledger.jsonl")
    recover(run)
    assert (run / "ledger.jsonl.torn").exists() and said(run).startswith("recovered: no rows")
    assert_holds(read_run(run), 20)


def test_lines_after_a_torn_seal_are_cut_by_the_next_record(run):
    with (run / "ledger.jsonl").open("ab") as ledger:
        ledger.write(b'{"sha256":"12')
    lines = len(ledger_lines := (run / "ledger.jsonl").read_bytes().split(b"\n"))
    assert f"line {lines} and later" in said(run)
    assert ledger_lines[-1] and read_run(run).manifest.exit_status == "complete"
    relabel(run, operator="bob")
    assert said(run) == "whole" and load_manifest(run).operator == "bob"


def test_recovery_after_a_failed_end_names_the_missing_rows(tmp_path, monkeypatch):
    writer = record(tmp_path)

    def refuse(table: object) -> bytes:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr("daq.store.stream_writer.to_parquet", refuse)
        with pytest.raises(CellError):
            writer.close("complete", "asked", {"g1": {"samples": 12}})
    path = writer.path
    (path / "g1-0001.arrow").write_bytes((path / "g1-0001.arrow").read_bytes()[:-300])
    recover(path)
    count, missing = said(path).splitlines()
    assert count.startswith("recovered: 4 rows") and missing.startswith("rows 8 to 11 of g1 ")
    assert load_manifest(path).counters == {"g1": {"samples": 8}}
    done = ran("verify", path)
    assert done.returncode == 3 and "4 rows" in done.stdout
    assert recover(path).nothing_to_do


@pytest.mark.parametrize("name", ["g1-0001.arrow", "ledger.jsonl", "manifest.json"])
@pytest.mark.parametrize("moved", [False, True])
def test_vanished_file_is_noticed_at_the_next_write_without_loss(tmp_path, name, moved):
    writer = record(tmp_path / "runs")
    if moved:
        (writer.path / name).rename(tmp_path / name)
    else:
        (writer.path / name).unlink()
    writer.append("g1", samples(4, 1, 12))
    writer.append("robot", samples(4, 2, 12))
    with refused("recording.failed", "disappeared during the recording"):
        writer.write()
    writer.close("failed", f"{name} has vanished", {})
    recover(writer.path)
    assert judge(writer.path).lines == []
    assert_holds(read_run(writer.path), 16)


def test_an_old_run_reads_and_is_not_sealed(old):
    assert_holds(read_run(old), 20)
    assert said(old).startswith("whole; sealed: no, ")
    assert recover(old).nothing_to_do and not (old / "ledger.jsonl").exists()
    assert relabel(old, operator="bob").operator == "bob"
    assert said(old).startswith("whole; sealed: no") and load_manifest(old).relabelled


@pytest.mark.parametrize(
    ("file", "missed"),
    [
        ("g1-0001.parquet", "rows 0 to 7 of g1 are missing"),
        ("g1-0002.parquet", "rows 8 to 15 of g1 are missing"),
        ("g1-0003.parquet", "g1 has 16 rows"),
    ],
)
def test_an_old_run_misses_a_chunk_that_went_with_its_entry(old, file, missed):
    manifest = json.loads((old / "manifest.json").read_text())
    manifest["chunks"] = [chunk for chunk in manifest["chunks"] if chunk["file"] != file]
    (old / "manifest.json").write_text(json.dumps(manifest))
    (old / file).unlink()
    assert said(old).startswith("not whole") and missed in said(old)


@pytest.mark.parametrize("lost", [None, "manifest.json"])
def test_an_old_crash_is_recovered_and_sealed(tmp_path, lost):
    path = Path(shutil.copytree(OLD / "version-1-crashed", tmp_path / "old"))
    if lost:
        (path / lost).unlink()
    with pytest.raises(FileError, match="rig recover"):
        read_run(path)
    assert not recover(path).nothing_to_do and recover(path).nothing_to_do
    assert said(path) == CUT
    assert_holds(read_run(path), 12)


def test_old_run_with_a_leftover_file_gets_a_complete_ledger(old):
    relabel(old, direction="acw")
    (old / "g1-0009.parquet.tmp").touch()
    before = load_manifest(old)
    recover(old)
    after = load_manifest(old)
    assert (after.direction, after.relabelled, after.counters) == ("acw", before.relabelled, before.counters)
    assert [chunk.sha256 for chunk in after.chunks] == [chunk.sha256 for chunk in before.chunks]
    assert said(old).startswith("recovered: no rows")


def test_a_manifest_of_a_version_to_come_is_refused(run):
    edit_manifest(run, {"version": 3})
    with refused("file.invalid", "file is from a newer version"):
        read_run(run)


@given(st.binary(max_size=400))
def test_any_bytes_are_a_ledger_that_ends_early(data):
    line, last = line_of(LedgerEntry(opening="0" * 64), "")
    found = verified(line + data)
    assert found.entries[0] == LedgerEntry(opening="0" * 64) and found.unread == len(data) and found.last == last


def test_counters_are_compared_only_if_the_run_ended_normally(tmp_path):
    """The last faults of a run that the disk ended need not be on it."""
    for ending, lines in (("failed", 0), ("complete", 1)):
        writer = start(tmp_path)
        writer.append_faults("g1", [fault(2)])
        writer.close(ending, "", {"g1": {"garbled": 7}})
        assert len(verify(writer.path)) == lines


def test_a_run_that_is_being_recorded_is_not_to_be_recovered(tmp_path):
    writer = record(tmp_path)
    (problem,) = verify(writer.path)
    assert problem.startswith(f"{writer.path}: ") and problem.endswith("rig record stop")
    crash(writer)
    assert any("`rig recover" in line for line in verify(writer.path))


def test_run_with_truncated_end_is_never_called_complete(tmp_path):
    """The last ledger lines, their chunks and the seal are missing, so the original length is unknown."""
    run = finished(tmp_path)
    was = judge(run)
    assert len(was.seal) == 64 and was.end_known
    lines = (run / "ledger.jsonl").read_bytes().splitlines(keepends=True)
    for line in lines[-4:-1]:
        (run / json.loads(line)["chunk"]["file"]).unlink()
    (run / "ledger.jsonl").write_bytes(b"".join(lines[:-4]))
    done = CliRunner().invoke(app, ["recover", str(run)])
    assert done.exit_code == 0 and "not sealed" in done.stdout
    assert END_UNKNOWN in said(run) and not judge(run).end_known
    verified_as = CliRunner().invoke(app, ["verify", str(run), "--seal", was.seal])
    assert verified_as.exit_code == 3 and "given seal" in verified_as.output


def test_the_seal_stays_the_one_that_was_printed(run, tmp_path):
    writer = record(tmp_path)
    writer.close("complete", "asked", {})
    assert judge(writer.path).seal == writer.seal != judge(run).seal
    relabel(writer.path, operator="somebody else")
    assert judge(writer.path).seal == writer.seal
    assert ran("verify", writer.path, "--seal", writer.seal).returncode == 0
