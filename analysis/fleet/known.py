"""The catalogue as the runs are now: what is new or has changed is read, what is gone is forgotten.

Runs are compared with the catalogue by names, sizes and times of files, and examined where these differ, by `each`, a
run at a time.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar

from analysis.batch.each import each
from analysis.batch.outcomes import Failed, Outcome
from analysis.batch.remote_store import StoreLost
from analysis.fleet import catalogue
from analysis.fleet.catalogue import Damaged, Entry
from analysis.fleet.examine import Examined, examine
from analysis.fleet.seen import Seen, seen_runs
from analysis.history.collect import Workers
from analysis.history.records import Record
from rigs.errors import FileError

T = TypeVar("T")
Progress = Callable[[str, int, int], None]
"""Called with what is done, and how much of how much of it."""
_SAVED_EVERY_S = 5.0
"""Time after which what was found is kept: an end in the middle costs no more."""


@dataclass(frozen=True)
class Known:
    """What the catalogue knows of each run by its path below the plant's directory; notes: what to know of the
    catalogue; examined and gone: how many runs were read, and how many are no longer there."""

    runs: Mapping[str, Entry]
    notes: tuple[str, ...]
    examined: int
    gone: int


def seen_below(directory: Path) -> list[Seen]:
    """The runs below a directory. Raises FileError where there is none, CellError where a store does not answer."""
    seen = list(seen_runs(directory))
    if not seen:
        raise FileError(str(directory), "holds no runs", "give the directory that holds the plant's runs")
    return seen


def remade(file: Path, work: Callable[[str], T]) -> T:
    """The value of work with a catalogue, which is made where it is missing, and once more where it is damaged.

    work: called with why the catalogue was made again, in words, empty where it was not. Raises CellError where the
    catalogue cannot be written.
    """
    why = catalogue.prepare(file)
    try:
        return work(why)
    except Damaged:
        catalogue.remove(file)
        catalogue.prepare(file)
        return work("was damaged")


def known_of(file: Path, seen: Sequence[Seen], workers: Workers, progress: Progress, why: str) -> Known:
    """The catalogue after the runs that are new or have changed were examined; why: it was made again.

    Raises Damaged, and StoreLost where a store does not answer any more: what was examined before is kept.
    """
    entries = catalogue.entries(file)
    fresh = [
        run
        for run in seen
        if not run.signature or (entries[run.run].signature if run.run in entries else "") != run.signature
    ]
    gone = sorted(entries.keys() - {run.run for run in seen})
    if gone:
        catalogue.forget(file, gone)
    if fresh:
        _examine(file, fresh, workers, progress)
    if fresh or gone:
        entries = catalogue.entries(file)
    notes = (f"{file} {why}: it was made again from the runs",) if why else ()
    return Known(entries, notes, len(fresh), len(gone))


def _examine(file: Path, fresh: Sequence[Seen], workers: Workers, progress: Progress) -> None:
    paths = [run.path.absolute() for run in fresh]  # a worker of a cluster has a directory of its own
    with closing(each(examine, paths, jobs=workers.jobs, scheduler=workers.scheduler)) as outcomes:
        examined = ((seen, _examined(outcome)) for seen, outcome in zip(fresh, outcomes, strict=True))
        kept(examined, partial(catalogue.keep, file), lambda done: progress("reading runs", done, len(fresh)))


def _examined(outcome: Outcome[Path, Examined | None]) -> Examined | None:
    """What was found of a run; one that cost a process or the memory, or could not be fetched, is tried again the next
    time. Raises StoreLost."""
    if isinstance(outcome, Failed):
        if isinstance(outcome.error, StoreLost):
            raise outcome.error
        return Examined(Record(outcome.item.name, "", "", "", "", "", "", problem=outcome.error.what), "", False)
    return outcome.value


def kept(items: Iterable[T], keep: Callable[[Sequence[T]], None], progress: Callable[[int], None]) -> None:
    """Keep what is found from time to time and at the end, however that comes."""
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
