"""From a directory of runs to the records of one robot: what is known is read, what is new is evaluated and kept."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

from analysis.apps.plant.history_file import FILE, Unusable, read_records, write_records
from analysis.apps.plant.records import Record, fingerprint_of, in_time, record_of, record_without_figures
from analysis.runs.batch.each import each
from analysis.runs.batch.outcomes import Done
from analysis.runs.batch.run_directories import run_directories
from daq.store import RunInfo, survey
from daq.store.retention import look
from rigs.errors import FileError
from rigs.load import parse
from rigs.rig import Rig
from rigs.schema.limits import Limits

Progress = Callable[[int, int], None]
"""Called with how many of how many runs are evaluated."""
_FEW = 4
"""So few runs this process evaluates before others would have started, unless their number is asked for."""
_SAVED_EVERY = 50
"""Runs after which what is evaluated is saved: a minute of work at most is lost."""
REASONS = {
    "damaged": "its manifest is missing, or it or the marks cannot be read",
    "crashed": "it was cut off: rig recover makes it readable",
    "recording": "it is being recorded",
}
"""Why a run has no figures, by its status."""


@dataclass(frozen=True)
class Workers:
    """Where runs are evaluated, as `analysis.runs.batch.each` has it."""

    jobs: int = 0
    scheduler: str | None = None


_HERE = Workers()


@dataclass(frozen=True)
class Job:
    """A run to evaluate, and what the history calls it."""

    run: RunInfo
    name: str
    fingerprint: str

    def __str__(self) -> str:
        return str(self.run.path)


@dataclass(frozen=True)
class Collected:
    """The runs of a robot in order of time, those without figures, what a person should know of the file, and the
    limits in the rig file of the newest run."""

    robot: str
    runs: tuple[Record, ...]
    broken: tuple[Record, ...]
    notes: tuple[str, ...]
    limits: Limits


def collect(directory: Path, robot: str, progress: Progress, how: Workers = _HERE) -> Collected:
    """The records of every run of a robot in a directory and below it, by the name of its rig file or of the robot in
    it. how: where runs are evaluated.

    Raises FileError where there is no such directory or no run of the robot.
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
        notes.append(f"{file} {why}: it is made again from the runs")
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
    return collected_of(robot, [*broken, *records], notes, rig_texts.__getitem__)


def collected_of(
    robot: str, records: Sequence[Record], notes: Sequence[str], rig_text_of: Callable[[str], str]
) -> Collected:
    """What the records of a robot's runs give, in any order; rig_text_of: the rig file of a run by its name."""
    # Each run once, also where a copy was relabelled or a table imported again: of a table the newest import is kept,
    # as it may have a corrected rig file.
    kept: dict[str, Record] = {}
    copy_notes = []
    for record in in_time(record for record in records if not record.problem):
        before = kept.setdefault(record.readings, record)
        if before is not record:
            copy, original = (before, record) if record.when > before.when else (record, before)
            kept[record.readings] = original
            copy_notes.append(f"{copy.name} is a copy of {original.name} and is left out")
    runs = in_time(kept.values())
    broken = sorted((record for record in records if record.problem), key=lambda record: record.name)
    rig = _rig_of(rig_text_of(runs[-1].name)) if runs else None
    return Collected(robot, tuple(runs), tuple(broken), (*notes, *copy_notes), rig.limits if rig else Limits())


def _runs_below(directory: Path) -> list[RunInfo]:
    """What is known of each run in a directory and below it. Raises FileError where there is no such directory."""
    runs = list(survey(directory))
    listed = {run.path.resolve() for run in runs}
    for run in run_directories([directory]):
        if run != directory and run.resolve() not in listed:
            with suppress(FileNotFoundError, PermissionError):  # as `survey` has it
                runs.append(look(run))
    return runs


def _name(run: Path, directory: Path) -> str:
    """What the history calls a run: its path below the directory."""
    return str(run.relative_to(directory))


def _broken(run: RunInfo, directory: Path, problem: str) -> Record:
    return replace(record_without_figures(run, problem), name=_name(run.path, directory))


def _in_memory(file: Path, why: str) -> str:
    return f"{file} cannot be used ({why}): every run is evaluated again each time"


def _sorted_out(
    directory: Path, runs: Sequence[RunInfo], records_before: dict[str, Record], broken: list[Record]
) -> tuple[list[Record], list[Job]]:
    """Records that still hold, and runs to evaluate; runs that cannot be read are added to broken."""
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


def _evaluated(jobs: Sequence[Job], progress: Progress, how: Workers) -> Iterator[list[Record]]:
    """The records of runs in pieces worth saving, at least one; what is done is saved where Ctrl-C ends it."""
    piece: list[Record] = []
    outcomes = each(_record, jobs, jobs=1 if len(jobs) <= _FEW and not how.jobs else how.jobs, scheduler=how.scheduler)
    try:
        for done, outcome in enumerate(outcomes, 1):
            # The record of a run; of one over which processes were killed without its fingerprint, so that it is tried
            # again
            record = (
                outcome.value
                if isinstance(outcome, Done)
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


def _record(job: Job) -> Record:
    assert job.run.manifest is not None  # noqa: S101 - as chosen in `_sorted_out`
    return replace(record_of(job.run.path, job.run.manifest, job.fingerprint), name=job.name)


def is_of(rig_name: str, rig_text: str, robot: str) -> bool:
    """Whether a run is of a robot, by the name of its rig file or of the robot in it."""
    if robot == rig_name:
        return True
    rig = _rig_of(rig_text)
    return rig is not None and rig.robot.name == robot


@lru_cache(maxsize=64)
def _rig_of(rig_text: str) -> Rig | None:
    """The rig of a run, None where its rig file cannot be read."""
    try:
        return parse(rig_text, "rig file")
    except FileError:
        return None


def no_run_of(robot: str, directory: Path, names: Collection[str]) -> FileError:
    """The error for a directory without a run of a robot; names: of the rig files of its runs."""
    remedy = (
        f"give one of {', '.join(sorted(names))}" if names else "give the directory that holds the runs: --runs DIR"
    )
    return FileError(str(directory), f"holds no run of a robot named {robot}", remedy)
