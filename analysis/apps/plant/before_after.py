"""Runs after a repair compared with runs before: the difference of each figure, and its significance.

The spread between runs is pooled over both sides and the history, because two runs per side hardly determine one. The
difference follows Student's distribution; the false findings are divided among the figures (Bonferroni).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from analysis.apps.plant.changes import FALSE_ALARMS, trend_of
from analysis.apps.plant.history import WATCHED, label_of, programs_of
from analysis.apps.plant.records import RunRecord, fingerprint_of, in_time, record_of
from analysis.apps.plant.store import FILE, read_records
from analysis.apps.report.blocks import Block, Sentence, Table, paragraphs
from analysis.procedures.shared.quantity import Quantity, student_factor
from analysis.runs.copied_runs import local_run
from analysis.runs.copies import refuse_copies
from analysis.runs.tabular import for_json
from daq.store import load_manifest
from rigs.errors import FileError

_FEWEST_OF_HISTORY = 10
"""Minimum number of runs in a series for a spread from the history."""
_EFFICIENCY = 0.37
"""Efficiency of a median absolute deviation relative to a standard deviation (normal distribution)."""


@dataclass(frozen=True)
class Difference:
    title: str
    figure: str
    before: float
    after: float
    difference: Quantity
    """After minus before, with infinite u if no spread is known."""
    explained: float
    """Largest difference that the spread explains, infinite if unknown."""
    runs_before: int
    runs_after: int

    @property
    def is_larger(self) -> bool:
        return abs(self.difference.value) > self.explained

    @property
    def sentence(self) -> str:
        change, label = self.difference, label_of(self.figure)
        is_known = bool(np.isfinite(change.u))
        verb = "went" if not is_known else "rose" if change.value > 0 else "fell"
        moved = (
            f"{label[0].upper()}{label[1:]} of {self.title} {verb} from {change.rounded(self.before)} to "
            f"{change.rounded(self.after)} {change.sign}"
        )
        if not is_known:
            return f"{moved}; repeat the runs: a single run per side does not show the spread."
        than = "more than" if self.is_larger else "within"
        return (
            f"{moved}, by {change.rounded(abs(change.value))} ± {change.rounded_u} {change.sign}: {than} the "
            f"{change.rounded(self.explained)} {change.sign} that the spread between runs explains."
        )

    def to_dict(self) -> dict[str, Any]:
        plain: dict[str, Any] = for_json(asdict(self) | {"is_larger": self.is_larger, "sentence": self.sentence})
        return plain


def headlines(compared: Sequence[Difference]) -> list[str]:
    larger = [difference.sentence for difference in compared if difference.is_larger]
    unknown = sum(not np.isfinite(difference.difference.u) for difference in compared)
    repeat = "record two or more runs on at least one side."
    if unknown == len(compared):
        return [f"The spread between runs is unknown, so no difference can be judged: {repeat}"]
    none = ["All differences are within the spread between runs."]
    unjudged = [f"Quantities with an unknown spread between runs, not assessed: {unknown}; {repeat}"] if unknown else []
    return [*(larger or none), *unjudged]


def differences_answer(compared: Sequence[Difference]) -> list[Block]:
    rows, title = [], ""
    for difference in compared:
        by = difference.difference
        is_known = bool(np.isfinite(by.u))
        verdict = ("yes" if difference.is_larger else "no") if is_known else "unknown: repeat the runs"
        cells = [by.rounded(value) for value in (difference.before, difference.after, by.value)]
        cells += [by.rounded_u, by.sign, by.rounded(difference.explained)] if is_known else ["", by.sign, ""]
        name = "" if difference.title == title else difference.title
        rows.append((name, label_of(difference.figure), *cells, verdict))
        title = difference.title
    before = max(difference.runs_before for difference in compared)
    counts = f"runs: {before} before, {max(difference.runs_after for difference in compared)} after"
    u = f"u: standard uncertainty by the spread between runs; explained: largest difference by that spread; {counts}"
    heads = ("", "", "before", "after", "difference", "u", "", "explained", "more than that")
    ranks = tuple("unusual" if difference.is_larger else "" for difference in compared)
    table = Table(heads, tuple(rows), frozenset({2, 3, 4, 5, 7}), ranks)
    return [*paragraphs(headlines(compared), "strong"), table, Sentence(u, "note")]


def differences(after: Sequence[Path], before: Sequence[Path]) -> list[Difference]:
    directories = {run.resolve().parent for run in (*before, *after)}
    histories = {directory: read_records(directory / FILE) for directory in directories}
    now, then = ([_record(run, histories) for run in side] for side in (after, before))
    sides = ((before, then, "before"), (after, now, "after"))
    refuse_copies(
        (path, record.readings, role)
        for paths, records, role in sides
        for path, record in zip(paths, records, strict=True)
    )
    robots = sorted({record.rig for record in (*now, *then)})
    if len(robots) > 1:
        where, remedy = " and ".join(robots), "compare runs of the same robot"
        raise FileError(where, "are different robots", remedy, code="robot.other")
    picked = []
    for title, group in programs_of([*then, *now]):
        old, new = ([record for record in side if record.key == group[0].key] for side in (then, now))
        if old and new:
            picked += [(title, name, old, new) for name in WATCHED if _all_have(name, group)]
    if not picked:
        problem = "the two sides share no combination of test, direction, placement and program"
        raise FileError("--against", problem, "give runs of the same test on both sides", code="runs.not_comparable")
    return [_difference(title, name, old, new, len(picked), histories) for title, name, old, new in picked]


def _record(run: Path, histories: dict[Path, dict[str, RunRecord]]) -> RunRecord:
    """Record of a run, from an up-to-date history in the same directory if possible."""
    path = run.resolve()
    with local_run(path) as directory:
        manifest = load_manifest(directory)
        try:
            fingerprint = fingerprint_of(directory)
        except OSError as error:
            raise FileError.of_os(path, error, "check the disk and the permissions", code="file.unreadable") from None
        record = histories[path.parent].get(path.name)
        if record is None or record.fingerprint != fingerprint:
            record = record_of(directory, manifest, fingerprint)
        if record.problem:
            raise FileError(str(run), record.problem, "remove it, or see rig verify", code="readings.unsuitable")
        return record


def _all_have(figure: str, records: Sequence[RunRecord]) -> bool:
    return all(figure in record.figures and np.isfinite(record.figures[figure].value) for record in records)


def _difference(
    title: str,
    figure: str,
    before: Sequence[RunRecord],
    after: Sequence[RunRecord],
    count: int,
    histories: dict[Path, dict[str, RunRecord]],
) -> Difference:
    from scipy.special import stdtrit  # noqa: PLC0415 - slow to import

    sides = [np.array([record.figures[figure].value for record in side]) for side in (before, after)]
    then, now = (float(side.mean()) for side in sides)
    freedom = float(sum(len(side) - 1 for side in sides))
    squares = float(sum(((side - side.mean()) ** 2).sum() for side in sides))
    spread, of_history = _spread_of_history(before[0].key, figure, histories)
    freedom, squares = freedom + of_history, squares + of_history * spread**2
    unit = before[0].figures[figure].unit
    u = limit = np.inf
    if freedom > 0:
        error = float(np.sqrt(squares / freedom * sum(1 / len(side) for side in sides)))
        u = error * student_factor(freedom)
        limit = error * float(stdtrit(freedom, 1 - FALSE_ALARMS / count / 2))
    difference = Quantity(now - then, u, unit)
    return Difference(title, figure, then, now, difference, limit, len(before), len(after))


def _spread_of_history(
    key: tuple[str, str, str, str], figure: str, histories: dict[Path, dict[str, RunRecord]]
) -> tuple[float, float]:
    """Standard deviation in the longest history, and degrees of freedom; 0 and 0 without one."""
    best: list[RunRecord] = []
    for records in histories.values():
        series = [
            record
            for record in records.values()
            if not record.problem and record.key == key and _all_have(figure, [record])
        ]
        best = max(best, series, key=len)
    if len(best) < _FEWEST_OF_HISTORY:
        return 0.0, 0.0
    quantities = [record.figures[figure] for record in in_time(best)]
    u = np.nan_to_num(np.array([quantity.u for quantity in quantities]), posinf=0.0)
    trend = trend_of(np.array([quantity.value for quantity in quantities]), u, 1)
    return trend.spread, _EFFICIENCY * (len(best) - 1) if trend.spread > 0 else 0.0
