"""From the directory of a plant to the states of its robots: only what is new or has changed is read.

Runs are compared with the catalogue by names, sizes and times of files, and examined where these differ; robots are
judged again where one of their runs differs. Both are done by `each`, a run and a robot at a time.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar

from analysis.batch.each import each
from analysis.batch.outcomes import Failed, Outcome
from analysis.fleet import catalogue
from analysis.fleet.catalogue import Damaged, Entry, Key
from analysis.fleet.examine import Examined, examine
from analysis.fleet.seen import Seen, seen_runs
from analysis.fleet.state import State, as_json, in_order, state_from_json, state_of
from analysis.history.collect import Collected, Workers, collected_of
from analysis.history.records import Record
from rigs.errors import FileError

T = TypeVar("T")
Progress = Callable[[str, int, int], None]
"""Called with what is done, and how much of how much of it."""
_SAVED_EVERY_S = 5.0
"""Time after which what was found is kept: an end in the middle costs no more."""


@dataclass(frozen=True)
class Fleet:
    """The robots of a plant, what needs attention first; strays: runs whose robot is not known, and why; notes: what
    to know of the catalogue; digests: of all that the state of each robot follows from; runs, examined and gone: how
    many runs there are, how many of them were read, and how many are no longer there."""

    directory: Path
    catalogue: Path
    robots: tuple[State, ...]
    strays: tuple[tuple[str, str], ...]
    notes: tuple[str, ...]
    digests: Mapping[Key, str]
    runs: int
    examined: int
    gone: int


def gather(directory: Path, file: Path, workers: Workers, progress: Progress) -> Fleet:
    """The robots of the runs below a directory; file: the catalogue, which is made where it is missing.

    workers: who reads the runs; robots are judged by processes of this machine alone, which have the catalogue.

    Raises FileError where there is no such directory or no run in it, CellError where the catalogue cannot be written.
    """
    seen = list(seen_runs(directory))
    if not seen:
        raise FileError(str(directory), "holds no runs", "give the directory that holds the plant's runs")
    why = catalogue.prepare(file)
    try:
        return _gathered(directory, file, seen, workers, progress, why)
    except Damaged:
        catalogue.remove(file)
        catalogue.prepare(file)
        return _gathered(directory, file, seen, workers, progress, "was damaged")


def _gathered(
    directory: Path, file: Path, seen: Sequence[Seen], workers: Workers, progress: Progress, why: str
) -> Fleet:
    known = catalogue.entries(file)
    fresh = [one for one in seen if not one.signature or _signature(known, one) != one.signature]
    gone = sorted(known.keys() - {one.run for one in seen})
    if gone:
        catalogue.forget(file, gone)
    if fresh:
        _examine(file, fresh, workers, progress)
    if fresh or gone:
        known = catalogue.entries(file)
    digests = _digests(known.values())
    return Fleet(
        directory,
        file,
        tuple(in_order(_judge(file, digests, workers, progress))),
        tuple((one.run, one.problem) for one in known.values() if not one.key[1]),
        (f"{file} {why}: it was made again from the runs",) if why else (),
        digests,
        len(known),
        len(fresh),
        len(gone),
    )


def _signature(known: Mapping[str, Entry], seen: Seen) -> str:
    return known[seen.run].signature if seen.run in known else ""


def _examine(file: Path, fresh: Sequence[Seen], workers: Workers, progress: Progress) -> None:
    paths = [one.path.absolute() for one in fresh]  # a worker of a cluster has a directory of its own
    outcomes = each(examine, paths, jobs=workers.jobs, scheduler=workers.scheduler)
    found = ((seen, _examined(outcome)) for seen, outcome in zip(fresh, outcomes, strict=True))
    _kept(found, partial(catalogue.keep, file), lambda done: progress("reading runs", done, len(fresh)))


def _kept(found: Iterable[T], keep: Callable[[Sequence[T]], None], progress: Callable[[int], None]) -> None:
    """Keep what is found from time to time and at the end, however that comes."""
    piece: list[T] = []
    saved_s = time.monotonic()
    try:
        for done, one in enumerate(found, 1):
            piece.append(one)
            progress(done)
            if time.monotonic() - saved_s > _SAVED_EVERY_S:
                keep(piece)
                piece, saved_s = [], time.monotonic()
    finally:
        keep(piece)


def _examined(outcome: Outcome[Path, Examined | None]) -> Examined | None:
    """What was found of a run; one that cost a process or the memory is tried again the next time."""
    if isinstance(outcome, Failed):
        return Examined(Record(outcome.item.name, "", "", "", "", "", "", problem=outcome.error.what), "", False)
    return outcome.value


def _digests(entries: Iterable[Entry]) -> dict[Key, str]:
    """A digest for each robot of all that its state follows from."""
    found: dict[Key, hashlib._Hash] = {}
    for one in entries:
        if one.key[1]:
            line = json.dumps([one.run, one.fingerprint, one.problem])
            found.setdefault(one.key, hashlib.sha256()).update(line.encode())
    return {key: digest.hexdigest() for key, digest in found.items()}


def _judge(file: Path, digests: Mapping[Key, str], workers: Workers, progress: Progress) -> list[State]:
    """The states of all robots; those whose runs are the same are as they were kept."""
    kept = catalogue.states(file)
    catalogue.forget_states(file, kept.keys() - digests.keys())
    fresh = [key for key, digest in digests.items() if key not in kept or kept[key][0] != digest]
    outcomes = each(judge, [(file, key) for key in fresh], jobs=workers.jobs)
    found = (_kept_state(outcome, digests) for outcome in outcomes)
    _kept(found, partial(catalogue.keep_states, file), lambda done: progress("judging robots", done, len(fresh)))
    try:
        return [state_from_json(text) for _, text in catalogue.states(file).values()]
    except (TypeError, ValueError) as error:
        raise Damaged(file, str(error)) from None


def _kept_state(outcome: Outcome[tuple[Path, Key], State], digests: Mapping[Key, str]) -> tuple[Key, str, str]:
    """A robot with its digest and state; one that could not be judged is tried again the next time."""
    _, key = outcome.item
    if not isinstance(outcome, Failed):
        return key, digests[key], as_json(outcome.value)
    if isinstance(outcome.error, Damaged):
        raise outcome.error
    return key, "", as_json(State(*key, problem=outcome.error.what))


def judge(item: tuple[Path, Key]) -> State:
    """The state of a robot, by its records in the catalogue."""
    file, (folder, robot) = item
    return state_of(folder, collected_in(file, (folder, robot)))


def collected_in(file: Path, key: Key) -> Collected:
    """What the catalogue holds of a robot. Raises CellError."""
    records, rig_texts = catalogue.records_of(file, key)
    return collected_of(key[1], records, (), rig_texts.__getitem__)
