"""From the directory of a plant to the states of its robots: only what is new or has changed is read.

The catalogue knows the runs (`analysis.fleet.known`); robots are judged again where one of their runs differs, by
`each`, a robot at a time.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from analysis.batch.each import each
from analysis.batch.outcomes import Failed, Outcome
from analysis.fleet import catalogue
from analysis.fleet.catalogue import Damaged, Entry, Key
from analysis.fleet.known import Progress, kept, known_of, remade, seen_below
from analysis.fleet.seen import Seen
from analysis.fleet.state import State, as_json, in_order, state_from_json, state_of
from analysis.history.collect import Collected, Workers, collected_of


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
    seen = seen_below(directory)
    return remade(file, partial(_gathered, directory, file, seen, workers, progress))


def _gathered(
    directory: Path, file: Path, seen: Sequence[Seen], workers: Workers, progress: Progress, why: str
) -> Fleet:
    catalogued = known_of(file, seen, workers, progress, why)
    digests = _digests(catalogued.runs.values())
    return Fleet(
        directory,
        file,
        tuple(in_order(_judge(file, digests, workers, progress))),
        tuple((entry.run, entry.problem) for entry in catalogued.runs.values() if not entry.key[1]),
        catalogued.notes,
        digests,
        len(catalogued.runs),
        catalogued.examined,
        catalogued.gone,
    )


def _digests(entries: Iterable[Entry]) -> dict[Key, str]:
    """A digest for each robot of all that its state follows from."""
    hashes: dict[Key, hashlib._Hash] = {}
    for entry in entries:
        if entry.key[1]:
            line = json.dumps([entry.run, entry.fingerprint, entry.problem])
            hashes.setdefault(entry.key, hashlib.sha256()).update(line.encode())
    return {key: digest.hexdigest() for key, digest in hashes.items()}


def _judge(file: Path, digests: Mapping[Key, str], workers: Workers, progress: Progress) -> list[State]:
    """The states of all robots; those whose runs are the same are as they were kept."""
    before = catalogue.states(file)
    catalogue.forget_states(file, before.keys() - digests.keys())
    # Not read back at the end: another command may have seen other robots meanwhile, of which this one knows no runs.
    states: dict[Key, State] = {}
    for key, (digest, text) in before.items():
        if digests.get(key) == digest:
            states[key] = _state(file, text)
    fresh = [key for key in digests if key not in states]
    outcomes = each(judge, [(file, key) for key in fresh], jobs=workers.jobs)
    judged = (_judged(outcome, digests, states) for outcome in outcomes)
    kept(judged, partial(catalogue.keep_states, file), lambda done: progress("judging robots", done, len(fresh)))
    return list(states.values())


def _state(file: Path, text: str) -> State:
    try:
        return state_from_json(text)
    except (TypeError, ValueError) as error:
        raise Damaged(file, str(error)) from None


def _judged(
    outcome: Outcome[tuple[Path, Key], State], digests: Mapping[Key, str], states: dict[Key, State]
) -> tuple[Key, str, str]:
    """A robot with its digest and state as they are kept, which is added to the states; one that could not be judged
    is tried again the next time."""
    _, key = outcome.item
    if isinstance(outcome, Failed):
        if isinstance(outcome.error, Damaged):
            raise outcome.error
        states[key] = State(*key, problem=outcome.error.what)
        return key, "", as_json(states[key])
    states[key] = outcome.value
    return key, digests[key], as_json(outcome.value)


def judge(item: tuple[Path, Key]) -> State:
    """The state of a robot, by its records in the catalogue."""
    file, (folder, robot) = item
    return state_of(folder, collected_in(file, (folder, robot)))


def collected_in(file: Path, key: Key) -> Collected:
    """What the catalogue holds of a robot. Raises CellError."""
    records, rig_texts = catalogue.records_of(file, key)
    return collected_of(key[1], records, (), rig_texts.__getitem__)
