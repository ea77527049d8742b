"""Records of runs: new and changed runs are evaluated and stored, the others are read from the file of figures.

Runs are compared by names, sizes and times of their files, without opening them.
"""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from datetime import datetime
from functools import lru_cache
from pathlib import Path
from typing import TypeVar

from analysis.apps.plant import store
from analysis.apps.plant.records import RunRecord, fingerprint_of, in_time, record_of, record_without_figures
from analysis.apps.plant.store import Entry
from analysis.runs.batch import FailedItem, Outcome, each, require_shared, run_directories
from analysis.runs.copied_runs import local_run
from daq.store import MovementCheck
from daq.store.ledger import LEDGER
from daq.store.manifest import MANIFEST, load_manifest
from daq.store.marks import load_marks
from daq.store.retention import look
from rigs.errors import FileError
from rigs.load import parse
from rigs.rig import Rig
from rigs.schema.limits import Limits

T = TypeVar("T")
Progress = Callable[[str, int, int], None]
"""Task, finished number, and total."""
_WITH_FIGURES = (MANIFEST, LEDGER, ".parquet", ".arrow")
"""Ends of the names of files that figures depend on: marks of exports and protection do not affect them."""
_FEW = 4
"""Evaluated in this process, unless jobs are given."""
_SAVED_EVERY_S = 5.0
"""Limits the loss by an interruption."""
REASONS = {
    "damaged": "the manifest is missing, or it or the marks cannot be read",
    "crashed": "it was interrupted: rig recover makes it readable",
    "recording": "it is being recorded",
}


@dataclass(frozen=True)
class Workers:
    jobs: int = 0
    scheduler: str | None = None


@dataclass(frozen=True)
class MarkedCheck:
    run: str
    when: datetime
    check: MovementCheck

    @property
    def has_moved(self) -> bool:
        return self.check.what not in ("", "nothing")


@dataclass(frozen=True)
class Collected:
    robot: str
    runs: tuple[RunRecord, ...]
    broken: tuple[RunRecord, ...]
    """Runs with no figures, by name."""
    notes: tuple[str, ...]
    """Notes on the file of figures, and on copies of runs."""
    limits: Limits
    """Limits in the rig file of the newest run."""
    checks: tuple[MarkedCheck, ...] = ()


def collect(directory: Path, robot: str, workers: Workers, progress: Progress) -> Collected:
    """Runs of a robot, which is named as in the rig file or by its model."""
    require_shared([directory], workers.scheduler)
    with local_run(directory) as local:
        return _collect(local, robot, workers, progress)


def _collect(directory: Path, robot: str, workers: Workers, progress: Progress) -> Collected:
    seen = runs_below(directory)
    file, notes = store.prepare_first([directory / store.FILE, store.default_path(directory)])
    others: set[str] = set()

    def may_be_of_robot(path: Path) -> bool:
        try:
            manifest = load_manifest(path)
        except (OSError, FileError):
            return True
        if is_mine := _is_of(manifest.rig_name, manifest.rig_text, robot):
            return is_mine
        others.add(manifest.rig_name)
        return False

    known, _, _ = update(file, seen, workers, progress, may_be_of_robot)
    records: list[RunRecord] = []
    rig_texts: dict[str, str] = {}
    is_known = False
    keys = sorted({entry.key for entry in known.values()})
    for folder, rig_name in keys:
        of_robot, texts = store.records_of(file, (folder, rig_name))
        for record in of_robot:
            is_mine = bool(rig_name) and _is_of(rig_name, texts[record.name], robot)
            if is_mine or not rig_name:  # A run of an unknown robot: the manifest is unreadable.
                name = str(Path(folder, record.name))
                records.append(replace(record, name=name))
                rig_texts[name] = texts[record.name]
                is_known |= is_mine
    if not is_known:
        names = sorted(others | {name for _, name in keys if name})
        remedy = f"choose from {', '.join(names)}" if names else "give the directory with the runs: --runs DIR"
        raise FileError(str(directory), f"contains no run of a robot named {robot}", remedy, code="run.missing")
    return replace(collected_of(robot, records, notes, rig_texts), checks=_checks_of(directory, records))


def collected_of(
    robot: str, records: Sequence[RunRecord], notes: Sequence[str], rig_texts: Mapping[str, str]
) -> Collected:
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
    rig = _rig_of(rig_texts[runs[-1].name]) if runs else None
    return Collected(robot, tuple(runs), tuple(broken), (*notes, *copy_notes), rig.limits if rig else Limits())


def _checks_of(directory: Path, records: Iterable[RunRecord]) -> tuple[MarkedCheck, ...]:
    """A check of several runs counts once, with its first run."""
    marked = []
    for record in records:
        with suppress(FileError, OSError, ValueError):  # of a damaged run, which is listed as such
            if check := load_marks(directory / record.name).moved:
                marked.append(MarkedCheck(record.name, record.when, check))
    first: dict[MovementCheck, MarkedCheck] = {}
    for one in sorted(marked, key=lambda one: (one.when.timestamp(), one.run)):
        first.setdefault(one.check, one)
    return tuple(first.values())


def _is_of(rig_name: str, rig_text: str, robot: str) -> bool:
    if robot == rig_name:
        return True
    rig = _rig_of(rig_text)
    return rig is not None and rig.robot.name == robot


@lru_cache(maxsize=64)
def _rig_of(rig_text: str) -> Rig | None:
    try:
        return parse(rig_text, "rig file")
    except FileError:
        return None


@dataclass(frozen=True)
class RunOnDisk:
    path: Path
    run: str
    """Path relative to the directory."""
    signature: str
    """Empty if the files cannot be listed or compared."""


def runs_below(directory: Path) -> list[RunOnDisk]:
    remedy = "give the directory with the plant's runs"
    if not directory.is_dir():
        raise FileError(str(directory), "no such directory", remedy, code="file.missing")
    if seen := list(_seen(directory)):
        return seen
    raise FileError(str(directory), "contains no runs", remedy, code="run.missing")


def _seen(directory: Path) -> Iterator[RunOnDisk]:
    for path in run_directories([directory]):
        if path != directory:  # It is returned itself if there are no runs.
            signature = ""
            with suppress(OSError), os.scandir(path) as entries:
                stats = {entry.name: entry.stat() for entry in entries if entry.name.endswith(_WITH_FIGURES)}
                signature = _digest([(name, stat.st_size, str(stat.st_mtime_ns)) for name, stat in stats.items()])
            yield RunOnDisk(path, os.path.relpath(path, directory), signature)


def _digest(files: Iterable[tuple[str, int, str]]) -> str:
    lines = "".join(f"{name} {size} {stamp}\n" for name, size, stamp in sorted(files))
    return hashlib.sha256(lines.encode("utf-8", "surrogateescape")).hexdigest()


def update(
    file: Path,
    seen: Sequence[RunOnDisk],
    workers: Workers,
    progress: Progress,
    is_wanted: Callable[[Path], bool] = lambda _: True,
) -> tuple[dict[str, Entry], int, int]:
    """Examine and store new and changed runs, and forget deleted ones; the stored runs, and how many were examined and
    forgotten.

    is_wanted: whether a new run is to be examined.
    """
    known = store.entries(file)
    changed = [
        run for run in seen if not run.signature or run.run not in known or known[run.run].signature != run.signature
    ]
    fresh = [run for run in changed if is_wanted(run.path)]
    gone = sorted(known.keys() - {run.run for run in seen})
    if gone:
        store.forget(file, gone)
    if not fresh:
        return store.entries(file) if gone else known, 0, len(gone)
    jobs = 1 if len(fresh) <= _FEW and not workers.jobs else workers.jobs
    paths = [run.path.absolute() for run in fresh]  # A cluster worker has a different working directory.

    def save(examined: Sequence[tuple[RunOnDisk, Examined | None]]) -> None:
        store.forget(file, [run.run for run, one in examined if one is None])
        stored = [(run, one) for run, one in examined if one is not None]
        store.save(
            file,
            [(run.run, run.signature if one.is_evaluated else "", one.record, one.rig_text) for run, one in stored],
        )

    def examined_in(outcome: Outcome[Path, Examined | None]) -> Examined | None:
        if not isinstance(outcome, FailedItem):
            return outcome.value
        # Repeat a run that killed a process or exhausted the memory.
        failed = record_without_figures(outcome.item.name, None, outcome.error.what)
        return Examined(failed, is_evaluated=False)

    with closing(each(examine, paths, jobs=jobs, scheduler=workers.scheduler)) as outcomes:
        examined = ((run, examined_in(outcome)) for run, outcome in zip(fresh, outcomes, strict=True))
        save_periodically(examined, save, lambda done: progress("reading runs", done, len(fresh)))
    return store.entries(file), len(fresh), len(gone)


def save_periodically(items: Iterable[T], keep: Callable[[Sequence[T]], None], progress: Callable[[int], None]) -> None:
    piece: list[T] = []
    saved_s = time.monotonic()
    try:
        for done, item in enumerate(items, 1):
            piece.append(item)
            progress(done)
            if time.monotonic() - saved_s > _SAVED_EVERY_S:
                keep(piece)
                piece, saved_s = [], time.monotonic()
    finally:
        keep(piece)


@dataclass(frozen=True)
class Examined:
    record: RunRecord
    rig_text: str = ""
    is_evaluated: bool = True
    """False if the run is to be examined again even without a change."""


def examine(path: Path) -> Examined | None:
    """Evaluate a run for the catalogue; None if the run is gone."""
    try:
        run = look(path)
    except OSError as error:
        if isinstance(error, FileNotFoundError) and not os.path.lexists(path):
            return None
        return Examined(record_without_figures(path.name, None, error.strerror or str(error)), is_evaluated=False)
    rig_text = run.manifest.rig_text if run.manifest else ""
    problem = REASONS.get(run.status, "")
    if run.manifest and not problem:
        try:
            return Examined(record_of(path, run.manifest, fingerprint_of(path)), rig_text)
        except (OSError, FileError) as error:
            problem = str(error)
    return Examined(record_without_figures(path.name, run.manifest, problem), rig_text, is_evaluated=False)
