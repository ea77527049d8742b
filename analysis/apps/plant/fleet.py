"""The robots of a plant: standing against the limits, changes with dates, and doubts of each.

The state of a robot is computed anew only if its runs changed.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any, Literal

from analysis.apps.plant import store
from analysis.apps.plant.changes import Change
from analysis.apps.plant.collect import (
    Collected,
    Progress,
    Workers,
    collected_of,
    runs_below,
    save_periodically,
    update,
)
from analysis.apps.plant.history import Series, history_of, judge
from analysis.apps.plant.history_sentences import against_limit, change_words
from analysis.apps.plant.store import Key
from analysis.runs.batch import FailedItem, Outcome, each, require_shared
from analysis.runs.copied_runs import local_run
from rigs.schema.limits import Standing

Attention = Literal["beyond", "watch", "unreadable", "changed", "within", "unlimited"]
ORDER: tuple[Attention, ...] = ("beyond", "watch", "unreadable", "changed", "within", "unlimited")


@dataclass(frozen=True)
class FleetRobot:
    folder: str
    robot: str
    tests: tuple[str, ...] = ()
    runs: int = 0
    last: str = ""
    standing: Standing | Literal[""] = ""
    worst: str = ""
    """The figure closest to its limit or furthest beyond it."""
    worst_ratio: float = 0.0
    """Value of this figure divided by the bound."""
    trend: str = ""
    changed: str = ""
    grew: bool = False
    without_figures: tuple[tuple[str, str], ...] = ()
    wild: int = 0
    copies: int = 0
    simulated: int = 0
    corrected: int = 0
    """Runs of corrected programs or with entered values, which do not show the arm."""
    problem: str = ""

    @property
    def attention(self) -> Attention:
        if self.standing == "fail":
            return "beyond"
        if self.standing == "watch":
            return "watch"
        if not self.runs:
            return "unreadable"
        if self.grew:
            return "changed"
        return "within" if self.standing else "unlimited"

    @property
    def doubts(self) -> list[str]:
        counts = (
            (len(self.without_figures), "without figures"),
            (self.wild, "excluded as outliers"),
            (self.copies, "copied"),
            (self.corrected, "driven with corrections, so they do not show the arm itself"),
        )
        return [*filter(None, [self.problem]), *(f"{count} {words}" for count, words in counts if count)]


def state_of(folder: str, collected: Collected) -> FleetRobot:
    broken = tuple((record.name, record.problem) for record in collected.broken)
    if not collected.runs:
        return FleetRobot(folder, collected.robot, without_figures=broken)
    history = history_of(collected)
    of_the_arm = [series for series in history.series if not series.corrected]
    standing, worst, ratio = _worst(of_the_arm)
    changed, trend, grew = _trend(of_the_arm)
    return FleetRobot(
        folder, collected.robot, tests=tuple(sorted({run.title for run in collected.runs})), runs=len(collected.runs),
        last=collected.runs[-1].when.isoformat(timespec="seconds"), standing=standing, worst=worst, worst_ratio=ratio,
        trend=trend, changed=changed, grew=grew, without_figures=broken,
        wild=sum(int(series.trend.wild.sum()) for series in history.series),
        copies=len(collected.notes),
        simulated=sum(run.simulated for run in collected.runs),
        corrected=sum(bool(run.corrected) for run in collected.runs),
    )  # fmt: skip


def in_order(states: Sequence[FleetRobot]) -> list[FleetRobot]:
    by_name = sorted(states, key=lambda state: (state.robot, state.folder))
    by_change = sorted(by_name, key=lambda state: state.changed if state.attention == "changed" else "", reverse=True)
    return sorted(by_change, key=lambda state: (ORDER.index(state.attention), -state.worst_ratio))


def _worst(all_series: Sequence[Series]) -> tuple[Standing | Literal[""], str, float]:
    """The largest ratio to the bound decides among equals."""
    judgements = []
    for series in all_series:
        judged = judge(series)
        if judged is not None:
            newest = judged.newest.figures[series.figure]
            rank = ("pass", "watch", "fail").index(judged.standing)
            judgements.append((rank, abs(newest.value) / judged.bound, judged.standing, series, newest))
    if not judgements:
        return "", "", 0.0
    _, ratio, standing, series, newest = max(judgements, key=lambda judgement: judgement[:2])
    return standing, f"{series.title}: {series.label} {newest}, {against_limit(series)}", ratio


def _trend(all_series: Sequence[Series]) -> tuple[str, str, bool]:
    """Day of the newest change, its words, and whether the figure grew.

    The last change of each series counts; growth comes first, then certainty.
    """
    last = [(series, series.trend.changes[-1]) for series in all_series if series.trend.changes]
    grown = [pair for pair in last if abs(pair[1].after) > abs(pair[1].before)]
    if not last:
        return "", "", False

    def newest(pair: tuple[Series, Change]) -> tuple[datetime, float]:
        series, change = pair
        return series.runs[change.last].when, -change.chance

    series, change = max(grown or last, key=newest)
    further = f", and {len(last) - 1} more" if len(last) > 1 else ""
    words = f"{series.title}: {change_words(series, change)[1]}{further}"
    return series.runs[change.last].when.date().isoformat(), words, bool(grown)


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
    require_shared([directory], workers.scheduler)
    with local_run(directory) as local:
        seen, notes = runs_below(local), store.prepare(file)
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
            fields: dict[str, Any] = json.loads(text)
            fields |= {"tests": tuple(fields["tests"]), "without_figures": tuple(map(tuple, fields["without_figures"]))}
            states[key] = FleetRobot(**fields)
    fresh = [key for key in digests if key not in states]
    if gone_robots := before.keys() - digests.keys():
        store.save_states(file, (), gone_robots)

    def judged(outcome: Outcome[tuple[Path, Key], FleetRobot]) -> tuple[Key, str, str]:
        _, key = outcome.item
        digest = digests[key]
        if isinstance(outcome, FailedItem):  # without a digest, the robot is judged again the next time
            states[key], digest = FleetRobot(*key, problem=outcome.error.what), ""
        else:
            states[key] = outcome.value
        return key, digest, json.dumps(asdict(states[key]))

    outcomes = each(_state_in, [(file, key) for key in fresh], jobs=workers.jobs)
    save = partial(store.save_states, file)
    save_periodically(map(judged, outcomes), save, lambda done: progress("judging robots", done, len(fresh)))
    strays = tuple((entry.run, entry.problem) for entry in known.values() if not entry.key[1])
    robots = tuple(in_order(list(states.values())))
    return Fleet(directory, file, robots, strays, notes, digests, len(known), examined, gone)


def collected_in(file: Path, key: Key) -> Collected:
    records, rig_texts = store.records_of(file, key)
    return collected_of(key[1], records, (), rig_texts)


def _state_in(item: tuple[Path, Key]) -> FleetRobot:
    file, key = item
    return state_of(key[0], collected_in(file, key))
