"""States of a plant's robots. The state of a robot is computed anew only if its runs changed."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from analysis.apps.plant import store
from analysis.apps.plant.collect import (
    Collected,
    Progress,
    Workers,
    collected_of,
    runs_below,
    save_periodically,
    update,
)
from analysis.apps.plant.robot_state import FleetRobot, as_json, in_order, state_from_json, state_of
from analysis.apps.plant.store import Key
from analysis.runs.batch import FailedItem, Outcome, each


@dataclass(frozen=True)
class Fleet:
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
    """file: the catalogue, which local processes need for the states of robots."""
    seen, notes = runs_below(directory), store.prepare(file)
    known, examined, gone = update(file, seen, workers, progress)
    hashes: dict[Key, hashlib._Hash] = {}
    for entry in known.values():
        if entry.key[1]:
            line = json.dumps([entry.run, entry.fingerprint, entry.problem])
            hashes.setdefault(entry.key, hashlib.sha256()).update(line.encode())
    digests = {key: digest.hexdigest() for key, digest in hashes.items()}
    before = store.states(file)
    # Not read back at the end: a parallel command may have stored robots unknown to this command.
    states: dict[Key, FleetRobot] = {}
    for key, (digest, text) in before.items():
        if digests.get(key) == digest:
            states[key] = state_from_json(text)
    fresh = [key for key in digests if key not in states]
    if gone_robots := before.keys() - digests.keys():
        store.save_states(file, (), gone_robots)

    def judged(outcome: Outcome[tuple[Path, Key], FleetRobot]) -> tuple[Key, str, str]:
        _, key = outcome.item
        if not isinstance(outcome, FailedItem):
            states[key] = outcome.value
            return key, digests[key], as_json(states[key])
        states[key] = FleetRobot(*key, problem=outcome.error.what)
        return key, "", as_json(states[key])

    outcomes = each(judge, [(file, key) for key in fresh], jobs=workers.jobs)
    save = partial(store.save_states, file)
    save_periodically(map(judged, outcomes), save, lambda done: progress("judging robots", done, len(fresh)))
    strays = tuple((entry.run, entry.problem) for entry in known.values() if not entry.key[1])
    robots = tuple(in_order(list(states.values())))
    return Fleet(directory, file, robots, strays, notes, digests, len(known), examined, gone)


def judge(item: tuple[Path, Key]) -> FleetRobot:
    file, (folder, robot) = item
    return state_of(folder, collected_in(file, (folder, robot)))


def collected_in(file: Path, key: Key) -> Collected:
    records, rig_texts = store.records_of(file, key)
    return collected_of(key[1], records, (), rig_texts)
