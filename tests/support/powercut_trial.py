"""Recordings interrupted by a power cut after any change: all promised rows must be present and correct.

The real `RunWriter` records with new chunks, occasional syncs and an end. Whenever it reports rows as safe, the log
gets a mark. For each trial the log is cut at a random position, a possible disk state is created and recovered, and the
result is compared with the last mark. One third of the recoveries are interrupted by a second cut, and one sixth first
fail because the disk is full.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from random import Random

from daq.store import RunWriter, judge, load_manifest, read_run, recover
from daq.store.writer import DiskOperation
from rigs.errors import CellError, FileError
from tests.support.powercut import BLOCK, Change, IoWorker, Mark, Watched, survivors, watched
from tests.support.store_cases import STREAMS, assert_rows, fault, samples, start, write_and_roll, write_and_sync

ENDED = "ended"


@dataclass(frozen=True)
class Recording:
    """Changes of a recording and the initial disk. full: a quota ended the recording."""

    before: IoWorker
    log: list[Change]
    full: bool


def recording(root: Path, seed: int) -> Recording:
    """Record below root. A mark {stream: rows} follows each sync, and `ENDED` the end.

    Every third recording reaches a quota that statvfs does not show.
    """
    random = Random(seed)
    full = False
    with watched(root) as watch:
        writer = start(root / "cell" / "runs", chunk_rows=random.choice((20, 40, 200)))
        watch.mark(_rows(writer))
        if random.random() < 1 / 3:
            watch.limit(watch.used + random.randint(2, 40) * BLOCK)
        try:
            for _ in range(12):
                _one_round(writer, watch, random)
        except CellError:
            full = True
        with suppress(CellError):
            writer.close("failed" if full else "complete", "told to stop", {stream: {} for stream in STREAMS})
            watch.mark(ENDED)
    return Recording(watch.before, watch.log, full)


def _one_round(writer: RunWriter, watch: Watched, random: Random) -> None:
    _append(writer, random)
    writer.write()
    what = random.random()
    if what < 0.4:
        write_and_sync(writer)
        watch.mark(_rows(writer))
        write_and_roll(writer)
    elif what < 0.7:
        rows = _rows(writer)
        _meanwhile(writer, writer.begin_sync(), random)
        watch.mark(rows)
        if rolling := writer.begin_roll():
            _meanwhile(writer, rolling, random)


def _append(writer: RunWriter, random: Random) -> None:
    for stream, columns in STREAMS.items():
        # private _writers: the count of rows that the trial expects is that of the writer itself
        stream_writer = writer._writers[stream]
        first = stream_writer.rows + len(stream_writer.pending)
        writer.append(stream, samples(random.choice((0, 1, 4, 30)), len(columns), first))
    if random.random() < 0.7:
        stream_writer = writer._writers["faults"]
        writer.append_faults("g1", [fault(stream_writer.rows + len(stream_writer.pending) + 1)])


def _meanwhile(writer: RunWriter, work: DiskOperation, random: Random) -> None:
    """Do part of the disk work while more rows are written, as in the daemon while another thread waits for the
    disk.
    """
    split, error = random.randint(0, len(work.steps)), None
    try:
        DiskOperation(work.steps[:split]).wait()
        _append(writer, random)
        writer.write()
        DiskOperation(work.steps[split:]).wait()
    except OSError as refused:
        error = refused
    writer.end_work(error)


def _rows(writer: RunWriter) -> dict[str, int]:
    return {stream: stream_writer.rows for stream, stream_writer in writer._writers.items()}


def trial(recorded: Recording, scratch: Path, seed: int) -> str:
    """Create and check one state below scratch: not begun, brought back or ended. Raises AssertionError."""
    random = Random(seed)
    log = recorded.log[: random.randint(0, len(recorded.log) * 11 // 10)]
    root = scratch / "first"
    survivors(recorded.before, log, random).put(root)
    said = [change.said for change in log if isinstance(change, Mark)]
    promised = next((rows for rows in reversed(said) if rows != ENDED), None)
    if promised is None:
        _check_not_begun(root)
        return "not begun"
    (path,) = (root / "cell" / "runs").iterdir()
    if ENDED in said:
        assert recover(path).nothing_to_do, "the store had said that the run was closed"
        assert load_manifest(path).exit_status == ("failed" if recorded.full else "complete")
    if random.random() < 1 / 3:
        path = _cut_again(path, scratch / "second", random)
    if random.random() < 1 / 6:
        _starve(path, random)
    with watched(path.parent):
        recover(path)
        assert recover(path).nothing_to_do, "a second recovery found something to do"
    check_rows(path, promised, may_miss=recorded.full)
    return "ended" if ENDED in said else "brought back"


def _check_not_begun(root: Path) -> None:
    """Check a state before the first promise: anything from nothing to a complete run, either reported or correct."""
    for path in (root / "cell" / "runs").glob("*"):
        try:
            recover(path)
        except FileError as error:
            assert "manifest" in str(error)
        else:
            check_rows(path, {}, may_miss=False)


def _cut_again(path: Path, root: Path, random: Random) -> Path:
    with watched(path.parent) as watch:
        recover(path)
    cut = random.randint(0, len(watch.log))  # all changes are present, so the run is complete
    survivors(watch.before, watch.log[:cut], random).put(root)
    if cut == len(watch.log):
        assert recover(root / path.name).nothing_to_do, "recover had said that it was done"
    return root / path.name


def _starve(path: Path, random: Random) -> None:
    """Recover with almost no free disk space."""
    with watched(path.parent) as watch, suppress(CellError):
        watch.limit(watch.used + random.randint(0, 6) * BLOCK)
        recover(path)


def check_rows(path: Path, promised: dict[str, int], *, may_miss: bool) -> None:
    """Compare every row with the recorded one, and their number with the promised one.

    may_miss: a run ended by a full disk counts rows that were written but never synced; rows lost by the power cut are
    then reported as missing.
    """
    verdict = judge(path)
    assert not verdict.problems, verdict.problems[0]
    assert all(may_miss and gap.first >= promised.get(gap.stream, 0) for gap in verdict.gaps), verdict.lines[0]
    run = read_run(path)
    for stream, columns in STREAMS.items():
        stored = run.streams[stream]
        assert_rows(stored, samples(len(stored["sequence"]), len(columns)), columns)
    expected_faults = [fault(number) for number in range(1, len(run.faults) + 1)]
    assert [(f["at_ns"], f["detail"], f["count"]) for f in run.faults] == [
        (f.at_ns, f.detail, f.count) for f in expected_faults
    ], "other faults than were recorded"
    held = {stream: len(run.streams[stream]["sequence"]) for stream in STREAMS} | {"faults": len(run.faults)}
    short = {stream: held[stream] for stream, rows in promised.items() if held[stream] < rows}
    assert not short, f"{short} rows of {promised} promised"
