"""Collection of the states of a plant's robots, reading only new and changed runs.

Runs are compared with the catalogue by names, sizes and times of files, and examined with `each` if they differ.
Deleted runs are removed. The state of a robot is recomputed if the runs changed.

A remote directory cannot contain history files, and reading each manifest would cost a request per run: the catalogue
identifies unchanged runs by listing only.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

from analysis.apps.plant import catalogue
from analysis.apps.plant.catalogue import CatalogueEntry, Damaged, Key
from analysis.apps.plant.collect import Collected, Workers, collected_of, is_of, no_run_of
from analysis.apps.plant.records import RunRecord
from analysis.apps.plant.robot_state import FleetRobot, as_json, in_order, state_from_json, state_of
from analysis.apps.plant.seen import Examined, RunOnDisk, examine, seen_runs
from analysis.runs.batch.each import each
from analysis.runs.batch.outcomes import FailedItem, Outcome
from analysis.runs.batch.remote_store import StoreLost
from rigs.errors import FileError

T = TypeVar("T")
Progress = Callable[[str, int, int], None]
"""A function called with the current task, the finished number and the total."""
_SAVED_EVERY_S = 5.0
"""Interval between saves, which limits the loss by an interruption."""


@dataclass(frozen=True)
class CatalogueContent:
    """Catalogue content by run path. notes: about the catalogue. examined, gone: numbers of runs read and deleted."""

    runs: Mapping[str, CatalogueEntry]
    notes: tuple[str, ...]
    examined: int
    gone: int


def seen_below(directory: Path) -> list[RunOnDisk]:
    """Return the runs below a directory. Raises FileError if there are none, CellError if a store does not respond."""
    seen = list(seen_runs(directory))
    if not seen:
        raise FileError(str(directory), "contains no runs", "give the directory with the plant's runs")
    return seen


def remade(file: Path, work: Callable[[str], T]) -> T:
    """Run work with a catalogue, which is created if missing, and rebuilt once if damaged.

    work: called with the reason for rebuilding, or an empty text. Raises CellError if the catalogue cannot be written.
    """
    why = catalogue.prepare(file)
    try:
        return work(why)
    except Damaged:
        catalogue.remove(file)
        catalogue.prepare(file)
        return work("was damaged")


def known_of(file: Path, seen: Sequence[RunOnDisk], workers: Workers, progress: Progress, why: str) -> CatalogueContent:
    """Return the catalogue after examining new and changed runs. why: reason for rebuilding.

    Raises Damaged, and StoreLost if a store stops responding: previous results are saved.
    """
    entries = catalogue.entries(file)
    fresh = [
        run
        for run in seen
        if not run.signature or (entries[run.run].signature if run.run in entries else "") != run.signature
    ]
    gone = sorted(entries.keys() - {run.run for run in seen})
    if gone:
        catalogue.remove_runs(file, gone)
    if fresh:
        paths = [run.path.absolute() for run in fresh]  # A cluster worker has a different working directory.
        with closing(each(examine, paths, jobs=workers.jobs, scheduler=workers.scheduler)) as outcomes:
            examined = ((seen, _examined(outcome)) for seen, outcome in zip(fresh, outcomes, strict=True))
            save_periodically(
                examined, partial(catalogue.keep, file), lambda done: progress("reading runs", done, len(fresh))
            )
    if fresh or gone:
        entries = catalogue.entries(file)
    notes = (f"{file} {why}: the file was rebuilt from the runs",) if why else ()
    return CatalogueContent(entries, notes, len(fresh), len(gone))


def _examined(outcome: Outcome[Path, Examined | None]) -> Examined | None:
    """Return the examination of a run.

    None, to be repeated later, if it killed a process, exhausted the memory, or could not be fetched. Raises StoreLost.
    """
    if isinstance(outcome, FailedItem):
        if isinstance(outcome.error, StoreLost):
            raise outcome.error
        return Examined(RunRecord(outcome.item.name, "", "", "", "", "", "", problem=outcome.error.what), "", False)
    return outcome.value


def save_periodically(items: Iterable[T], keep: Callable[[Sequence[T]], None], progress: Callable[[int], None]) -> None:
    """Save results periodically and at the end, also after an error."""
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
class Fleet:
    """The robots of a plant, most urgent first.

    strays: runs of unknown robots, with the reason. notes: about the catalogue. digests: of all inputs of the state of
    each robot. runs, examined, gone: numbers of runs, of runs read, and of deleted runs.
    """

    directory: Path
    catalogue: Path
    robots: tuple[FleetRobot, ...]
    strays: tuple[tuple[str, str], ...]
    notes: tuple[str, ...]
    digests: Mapping[Key, str]
    runs: int
    examined: int
    gone: int


def gather(directory: Path, file: Path, workers: Workers, progress: Progress) -> Fleet:
    """Return the robots of the runs below a directory. file: the catalogue, created if missing.

    workers: for reading runs. Only local processes compute the states of robots, because they need the catalogue.
    Raises FileError if the directory does not exist or contains no run, and CellError if the catalogue cannot be
    written.
    """
    seen = seen_below(directory)
    return remade(file, partial(_gathered, directory, file, seen, workers, progress))


def _gathered(
    directory: Path, file: Path, seen: Sequence[RunOnDisk], workers: Workers, progress: Progress, why: str
) -> Fleet:
    catalogued = known_of(file, seen, workers, progress, why)
    # Digest of all inputs of the state of each robot
    hashes: dict[Key, hashlib._Hash] = {}
    for entry in catalogued.runs.values():
        if entry.key[1]:
            line = json.dumps([entry.run, entry.fingerprint, entry.problem])
            hashes.setdefault(entry.key, hashlib.sha256()).update(line.encode())
    digests = {key: digest.hexdigest() for key, digest in hashes.items()}
    # States of all robots; stored states if the runs are unchanged
    before = catalogue.states(file)
    catalogue.forget_states(file, before.keys() - digests.keys())
    # Not read back at the end: a parallel command may have stored robots unknown to this command.
    states: dict[Key, FleetRobot] = {}
    for key, (digest, text) in before.items():
        if digests.get(key) == digest:
            try:
                states[key] = state_from_json(text)
            except (TypeError, ValueError) as error:
                raise Damaged(file, str(error)) from None
    fresh = [key for key in digests if key not in states]
    outcomes = each(judge, [(file, key) for key in fresh], jobs=workers.jobs)
    judged = (_judged(outcome, digests, states) for outcome in outcomes)
    save_periodically(
        judged, partial(catalogue.keep_states, file), lambda done: progress("judging robots", done, len(fresh))
    )
    return Fleet(
        directory,
        file,
        tuple(in_order(list(states.values()))),
        tuple((entry.run, entry.problem) for entry in catalogued.runs.values() if not entry.key[1]),
        catalogued.notes,
        digests,
        len(catalogued.runs),
        catalogued.examined,
        catalogued.gone,
    )


def _judged(
    outcome: Outcome[tuple[Path, Key], FleetRobot], digests: Mapping[Key, str], states: dict[Key, FleetRobot]
) -> tuple[Key, str, str]:
    """Add the state of a robot to the states, and return it for storage. A failed state is repeated later."""
    _, key = outcome.item
    if isinstance(outcome, FailedItem):
        if isinstance(outcome.error, Damaged):
            raise outcome.error
        states[key] = FleetRobot(*key, problem=outcome.error.what)
        return key, "", as_json(states[key])
    states[key] = outcome.value
    return key, digests[key], as_json(outcome.value)


def judge(item: tuple[Path, Key]) -> FleetRobot:
    """Return the state of a robot from the records in the catalogue."""
    file, (folder, robot) = item
    return state_of(folder, collected_in(file, (folder, robot)))


def collected_in(file: Path, key: Key) -> Collected:
    """Return the records of a robot in the catalogue. Raises CellError."""
    records, rig_texts = catalogue.records_of(file, key)
    return collected_of(key[1], records, (), rig_texts.__getitem__)


def collect_by_catalogue(directory: Path, robot: str, file: Path, workers: Workers, progress: Progress) -> Collected:
    """Return the records of a robot's runs below a directory. file: the catalogue, created if missing.

    Raises the errors of `gather`, and FileError if the robot has no run.
    """
    seen = seen_below(directory)
    return remade(file, partial(_collected, directory, robot, file, seen, workers, progress))


def _collected(
    directory: Path, robot: str, file: Path, seen: Sequence[RunOnDisk], workers: Workers, progress: Progress, why: str
) -> Collected:
    catalogued = known_of(file, seen, workers, progress, why)
    keys = sorted({entry.key for entry in catalogued.runs.values()})
    records: list[RunRecord] = []
    rig_texts: dict[str, str] = {}
    is_known = False
    for folder, rig_name in keys:
        of_robot, texts = catalogue.records_of(file, (folder, rig_name))
        for record in of_robot:
            is_mine = bool(rig_name) and is_of(rig_name, texts[record.name], robot)
            if is_mine or not rig_name:  # A run of an unknown robot: the manifest is unreadable.
                name = str(Path(folder, record.name))
                records.append(replace(record, name=name))
                rig_texts[name] = texts[record.name]
                is_known |= is_mine
    if not is_known:
        raise no_run_of(robot, directory, {name for _, name in keys if name})
    return collected_of(robot, records, catalogued.notes, rig_texts.__getitem__)
