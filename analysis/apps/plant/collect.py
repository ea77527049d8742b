"""Collection of the records of a robot from a directory of runs: new runs are evaluated and stored, others are read."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import datetime
from functools import lru_cache
from pathlib import Path

from analysis.apps.plant.history_file import FILE, Unusable, read_records, write_records
from analysis.apps.plant.records import RunRecord, fingerprint_of, in_time, record_of, record_without_figures
from analysis.runs.batch.each import each
from analysis.runs.batch.outcomes import CompletedItem
from analysis.runs.batch.run_directories import run_directories
from daq.store import MovementCheck, RunInfo, survey
from daq.store.retention import look
from rigs.errors import FileError
from rigs.load import parse
from rigs.rig import Rig
from rigs.schema.limits import Limits

Progress = Callable[[int, int], None]
"""A function called with the number of evaluated runs and the total."""
_FEW = 4
"""Number of runs up to which they are evaluated in this process, unless jobs are specified."""
_SAVED_EVERY = 50
"""Number of runs between two saves: at most a minute of work can be lost."""
REASONS = {
    "damaged": "the manifest is missing, or it or the marks cannot be read",
    "crashed": "it was interrupted: rig recover makes it readable",
    "recording": "it is being recorded",
}
"""Reasons for missing figures, by status of the run."""


@dataclass(frozen=True)
class Workers:
    """The execution of evaluations, see `analysis.runs.batch.each`."""

    jobs: int = 0
    scheduler: str | None = None


_HERE = Workers()


@dataclass(frozen=True)
class Job:
    """A run to evaluate, and its name in the history."""

    run: RunInfo
    name: str
    fingerprint: str

    def __str__(self) -> str:
        return str(self.run.path)


@dataclass(frozen=True)
class MarkedCheck:
    """A movement check stored with a run. when: start of the run, in the time zone of this computer."""

    run: str
    when: datetime
    check: MovementCheck

    @property
    def has_moved(self) -> bool:
        """True if a cause was named, other than "nothing"."""
        return self.check.what not in ("", "nothing")


@dataclass(frozen=True)
class Collected:
    """The runs of a robot in order of time, runs with no figures, notes about the file, the limits of the newest run,
    and movement checks in order of time."""

    robot: str
    runs: tuple[RunRecord, ...]
    broken: tuple[RunRecord, ...]
    notes: tuple[str, ...]
    limits: Limits
    checks: tuple[MarkedCheck, ...] = ()


def collect(directory: Path, robot: str, progress: Progress, how: Workers = _HERE) -> Collected:
    """Return the records of every run of a robot in or below a directory, by the name of the rig file or of the robot.

    how: execution of evaluations. Raises FileError if the directory does not exist or contains no run of the robot.
    """
    file = directory / FILE
    notes: list[str] = []
    try:
        records_before, why = read_records(file)
        usable = True
    except Unusable as error:
        records_before, why, usable = {}, "", False
        notes.append(_in_memory(file, str(error)))
    if why:
        notes.append(f"{file} {why}: the file is rebuilt from the runs")
    runs = _runs_below(directory)
    broken = [_broken(run, directory, REASONS["damaged"]) for run in runs if run.manifest is None]
    mine = [
        run for run in runs if run.manifest is not None and is_of(run.manifest.rig_name, run.manifest.rig_text, robot)
    ]
    if not mine:
        raise no_run_of(robot, directory, {run.manifest.rig_name for run in runs if run.manifest})
    records, jobs = _sorted_out(directory, mine, records_before, broken)
    gone = sorted(records_before.keys() - {_name(run.path, directory) for run in runs})
    for fresh in _evaluated(jobs, progress, how):
        records += fresh
        if usable and (fresh or gone or why):
            try:
                write_records(file, fresh, gone, from_new=bool(why))
                gone, why = [], ""
            except Unusable as error:
                usable = False
                notes.append(_in_memory(file, str(error)))
    rig_texts = {_name(run.path, directory): run.manifest.rig_text for run in mine if run.manifest}
    collected = collected_of(robot, [*broken, *records], notes, rig_texts.__getitem__)
    return replace(collected, checks=_checks_of(mine, directory))


def _checks_of(runs: Sequence[RunInfo], directory: Path) -> tuple[MarkedCheck, ...]:
    """Return the movement checks of runs in order of time, a check of several runs once, with its first run."""
    marked = []
    for run in runs:
        if run.manifest is not None and run.marks is not None and run.marks.moved is not None:
            name = _name(run.path, directory)
            marked.append(MarkedCheck(name, record_without_figures(run, "").when, run.marks.moved))
    first: dict[MovementCheck, MarkedCheck] = {}
    for check in sorted(marked, key=lambda check: (check.when.timestamp(), check.run)):
        first.setdefault(check.check, check)
    return tuple(first.values())


def collected_of(
    robot: str, records: Sequence[RunRecord], notes: Sequence[str], rig_text_of: Callable[[str], str]
) -> Collected:
    """Combine the records of a robot's runs, in any order. rig_text_of: returns the rig file of a run by name."""
    # Each run counts once, even after relabelling a copy or importing a table twice. The newest import of a table has
    # priority, because the rig file may have been corrected.
    kept: dict[str, RunRecord] = {}
    copy_notes = []
    for record in in_time(record for record in records if not record.problem):
        before = kept.setdefault(record.readings, record)
        if before is not record:
            copy, original = (before, record) if record.when > before.when else (record, before)
            kept[record.readings] = original
            copy_notes.append(f"{copy.name} is a copy of {original.name} and is ignored")
    runs = in_time(kept.values())
    broken = sorted((record for record in records if record.problem), key=lambda record: record.name)
    rig = _rig_of(rig_text_of(runs[-1].name)) if runs else None
    return Collected(robot, tuple(runs), tuple(broken), (*notes, *copy_notes), rig.limits if rig else Limits())


def _runs_below(directory: Path) -> list[RunInfo]:
    """Return the facts about each run in or below a directory. Raises FileError if the directory does not exist."""
    runs = list(survey(directory))
    listed = {run.path.resolve() for run in runs}
    for run in run_directories([directory]):
        if run != directory and run.resolve() not in listed:
            with suppress(FileNotFoundError, PermissionError):  # As in `survey`
                runs.append(look(run))
    return runs


def _name(run: Path, directory: Path) -> str:
    """Return the name of a run in the history: its path below the directory."""
    return str(run.relative_to(directory))


def _broken(run: RunInfo, directory: Path, problem: str) -> RunRecord:
    return replace(record_without_figures(run, problem), name=_name(run.path, directory))


def _in_memory(file: Path, why: str) -> str:
    return f"{file} cannot be used ({why}): all runs must be evaluated each time"


def _sorted_out(
    directory: Path, runs: Sequence[RunInfo], records_before: dict[str, RunRecord], broken: list[RunRecord]
) -> tuple[list[RunRecord], list[Job]]:
    """Return the valid records, and the runs to evaluate. Unreadable runs are added to `broken`."""
    records, jobs = [], []
    for run in runs:
        assert run.manifest is not None  # noqa: S101 - as chosen by the caller
        name = _name(run.path, directory)
        if run.status in REASONS:
            broken.append(_broken(run, directory, REASONS[run.status]))
            continue
        try:
            fingerprint = fingerprint_of(run.path)
        except (OSError, FileError) as error:
            broken.append(_broken(run, directory, str(error)))
            continue
        record = records_before.get(name)
        if record is not None and record.fingerprint == fingerprint:
            records.append(record)
        else:
            jobs.append(Job(run, name, fingerprint))
    return records, jobs


def _evaluated(jobs: Sequence[Job], progress: Progress, how: Workers) -> Iterator[list[RunRecord]]:
    """Yield the records of runs in batches to save, at least one batch. Finished records are saved on Ctrl-C."""
    piece: list[RunRecord] = []
    outcomes = each(_record, jobs, jobs=1 if len(jobs) <= _FEW and not how.jobs else how.jobs, scheduler=how.scheduler)
    try:
        for done, outcome in enumerate(outcomes, 1):
            # The record of a run; if processes were killed, it has no fingerprint and is therefore repeated later
            record = (
                outcome.value
                if isinstance(outcome, CompletedItem)
                else replace(record_without_figures(outcome.item.run, outcome.error.what), name=outcome.item.name)
            )
            piece.append(record)
            progress(done, len(jobs))
            if len(piece) == _SAVED_EVERY:
                yield piece
                piece = []
    except KeyboardInterrupt:
        yield piece
        raise
    yield piece


def _record(job: Job) -> RunRecord:
    assert job.run.manifest is not None  # noqa: S101 - as chosen in `_sorted_out`
    return replace(record_of(job.run.path, job.run.manifest, job.fingerprint), name=job.name)


def is_of(rig_name: str, rig_text: str, robot: str) -> bool:
    """Return whether a run belongs to a robot, by the name of its rig file or robot."""
    if robot == rig_name:
        return True
    rig = _rig_of(rig_text)
    return rig is not None and rig.robot.name == robot


@lru_cache(maxsize=64)
def _rig_of(rig_text: str) -> Rig | None:
    """Return the rig of a run, None if the rig file is unreadable."""
    try:
        return parse(rig_text, "rig file")
    except FileError:
        return None


def no_run_of(robot: str, directory: Path, names: Collection[str]) -> FileError:
    """Return the error for a directory with no run of a robot. names: rig files of the other runs."""
    remedy = f"choose from {', '.join(sorted(names))}" if names else "give the directory with the runs: --runs DIR"
    return FileError(str(directory), f"contains no run of a robot named {robot}", remedy)
