"""Runs of a directory for pages, with figures from the history file, and as Prometheus metrics."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from analysis.apps.plant.records import RunRecord
from analysis.apps.plant.store import FILE, read_records
from analysis.apps.report.texts import LEADING, in_order
from analysis.cli.listings import run_row
from analysis.procedures.shared.quantity import Quantity
from daq.service.exposition import Metric, render
from daq.store import survey
from daq.store.manifest import is_run
from daq.store.retention import RunInfo, look
from rigs.errors import FileError, RigError
from rigs.load import parse
from rigs.schema.limits import Limit, Limits, Standing

MOST_SHOWN = 300
_WORST: tuple[Standing, ...] = ("fail", "watch", "pass")


@dataclass(frozen=True)
class Figure:
    name: str
    value: Quantity
    limit: Limit | None
    """None if the rig file has no limit for the figure; then there is no standing."""
    standing: Standing | None


@dataclass(frozen=True)
class ShelfRun:
    """A run with the fields of `rig runs --json`, the history record if any, and the figures."""

    name: str
    path: Path
    about: Mapping[str, Any]
    record: RunRecord | None
    figures: tuple[Figure, ...]

    @property
    def started(self) -> str:
        return self.record.started[:16].replace("T", " ") if self.record else ""

    @property
    def title(self) -> str:
        return " ".join(filter(None, (self.about["test"], self.about["direction"])))

    @property
    def leading(self) -> tuple[Figure, ...]:
        return tuple(figure for figure in self.figures if figure.name in LEADING)

    @property
    def standing(self) -> Standing | None:
        standings = {figure.standing for figure in self.figures}
        return next((worst for worst in _WORST if worst in standings), None)


class Shelf:
    """Directory of runs. It does not need to exist."""

    def __init__(self, directory: Path) -> None:
        self.directory = directory

    def runs(self, words: str = "") -> tuple[list[ShelfRun], int]:
        """Newest runs with all words in name, test, state or rig, and the total number of such runs."""
        searched, matching = words.lower().split(), []
        try:
            for run in survey(self.directory):
                of_run = [run.path.name, run.status]
                if (manifest := run.manifest) is not None:
                    of_run += [manifest.test, manifest.direction or "", manifest.rig_name]
                if all(word in " ".join(of_run).lower() for word in searched):
                    matching.append(run)
        except FileError:  # the first recording creates the directory
            return [], 0
        matching.sort(key=lambda run: run.ended_s, reverse=True)
        records = read_records(self.directory / FILE)
        return [_shelf_run(run, records.get(run.path.name)) for run in matching[:MOST_SHOWN]], len(matching)

    def run(self, name: str) -> ShelfRun:
        path = self.directory / name
        try:
            is_here = path.parent == self.directory and not name.startswith(".") and not path.is_symlink()
            if is_here and is_run(path):
                return _shelf_run(look(path), read_records(self.directory / FILE).get(name))
        except (OSError, ValueError):
            pass
        raise FileError(name, "is not a run in this directory", "choose a run from the list", code="run.missing")

    def has_record_of(self, runs: Iterable[ShelfRun]) -> bool:
        """True if the history file now contains one of the runs."""
        records = read_records(self.directory / FILE)
        return any(run.name in records for run in runs)

    def robots(self) -> list[str]:
        return sorted({str(run.about["rig"]) for run in self.runs()[0] if run.about["rig"]})


def _shelf_run(run: RunInfo, record: RunRecord | None) -> ShelfRun:
    limits = limits_of(run.manifest.rig_text) if run.manifest else Limits()
    figures = record.figures if record else {}
    judged = []
    for name in in_order(figures):
        limit = limits.of(record.test, name) if record else None
        value = figures[name]
        judged.append(Figure(name, value, limit, limit.standing(value.value, value.u) if limit else None))
    return ShelfRun(run.path.name, run.path, run_row(run, time.time()), record, tuple(judged))


@lru_cache(maxsize=64)
def limits_of(rig_text: str) -> Limits:
    """Limits in the rig file of a run; empty if it is unreadable."""
    try:
        return parse(rig_text, "the rig file of the run").limits
    except RigError:
        return Limits()


def metrics_of(runs: Iterable[ShelfRun], *, daemon_is_up: bool) -> str:
    """State of the daemon, and the main and limited figures of the newest run per rig, test and direction."""
    newest: set[tuple[str, ...]] = set()
    shown: list[tuple[dict[str, str], Figure]] = []
    for run in runs:
        record = run.record
        if record is None or not run.figures or (key := (record.rig, record.test, record.direction)) in newest:
            continue
        newest.add(key)
        labels = dict(zip(("rig", "test", "direction"), key, strict=True))
        shown += [({**labels, "figure": one.name}, one) for one in run.figures if one.limit or one.name in LEADING]
    bounds = [
        ({**labels, "bound": bound}, float(getattr(figure.limit, bound)))
        for labels, figure in shown
        for bound in ("watch", "fail")
        if getattr(figure.limit, bound, None) is not None
    ]
    standings = [
        ({**labels, "standing": name}, float(figure.standing == name))
        for labels, figure in shown
        for name in reversed(_WORST)
        if figure.standing
    ]
    values = [(labels, figure.value.value) for labels, figure in shown]
    uncertainties = [(labels, figure.value.u) for labels, figure in shown]
    return render(
        Metric(name, "gauge", help_text, tuple(samples))
        for name, help_text, samples in (
            ("rig_up", "1 if rigd answers, otherwise 0.", [({}, float(daemon_is_up))]),
            ("rig_figure", "Result of the newest run of each test, in the unit of its name.", values),
            ("rig_figure_uncertainty", "Its standard uncertainty.", uncertainties),
            ("rig_figure_limit", "Limits of the rig file: lower bounds of watch and of fail.", bounds),
            ("rig_figure_standing", "1 for the current state of the result relative to its limits.", standings),
        )
    )
